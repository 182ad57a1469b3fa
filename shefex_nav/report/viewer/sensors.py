"""What the viewer shows of IMU, GPS and instruments: rates, vibration, satellites, how old data are."""

import numpy as np

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.instruments import TABLE
from shefex_nav.report.viewer import layout, world
from shefex_nav.report.viewer.sender import AXES, BLUE, GREEN, ORANGE, WHITE, YELLOW, plot_step, plotted

VIBRATION_S = 1.0  # over which the scatter of the specific force is taken


def send(sender, data):
    """Everything of one run."""
    imu(sender, data)
    gps(sender, data)
    instruments(sender, data)
    ages(sender, data)


def imu(sender, data):
    """Mean rate and specific force of the ticks, scatter of the specific force within a second."""
    block = data.imu
    if not len(block.t_valid_s):
        return
    t_s, dt_s = block.t_valid_s, block.dt_s[:, None]
    n = block.dv_b.shape[1]
    dtheta_b, dv_b = (
        np.where(block.valid[:, None, None], column, np.nan) for column in (block.dtheta_b, block.dv_b)
    )
    rate = np.degrees(dtheta_b.sum(axis=1) / (n * dt_s))
    force = dv_b.sum(axis=1) / (n * dt_s) / STANDARD_GRAVITY
    for name, values in (("rate", rate), ("force", force)):
        for (axis, colour), one in zip(AXES.items(), values.T, strict=True):
            rows = plotted(t_s, one)
            sender.curve(f"plots/imu/{name}/{axis}", t_s[rows], one[rows], colour, axis)
    times, scatter = vibration(t_s, dv_b / dt_s[:, :, None] / STANDARD_GRAVITY)
    sender.axes("plots/imu/vibration", times, scatter)


def vibration(t_s, force):
    """Standard deviation of the differences between neighbouring samples over the root of two, each second.

    Slow changes of the specific force drop out of the differences. Samples that are missing (NaN) count
    neither as calm nor as shaken: of a second without any there is nothing to say, NaN.

    (N,) s, (N, n, 3) -> (M,), (M, 3)
    """
    per_tick = np.diff(force, axis=1) ** 2
    second = np.floor((t_s - t_s[0]) / VIBRATION_S).astype(int)
    starts = np.flatnonzero(np.diff(second, prepend=-1))
    if force.shape[1] < 2 or not len(starts):
        return np.zeros(0), np.zeros((0, 3))
    known = np.isfinite(per_tick)
    sums, counts = (
        np.add.reduceat(column.sum(axis=1), starts)
        for column in (np.where(known, per_tick, 0.0), known.astype(float))
    )
    return t_s[starts], np.sqrt(
        np.divide(sums, 2.0 * counts, out=np.full(sums.shape, np.nan), where=counts > 0)
    )


def gps(sender, data):
    """Fix or none as a lane, satellites, dilution of precision."""
    fixes = data.gps
    times = [fix.t_valid_s for fix in fixes]
    states = ["fix" if fix.valid else "no fix" for fix in fixes]
    sender.lane("states/gps", times, states, {"fix": GREEN, "no fix": ORANGE}, world.time_span(data))
    if layout.knows_satellites(fixes):
        sender.curve("plots/gps/satellites", times, [f.n_satellites for f in fixes], GREEN, "satellites used")
        pdop = [f.pdop if f.valid else np.nan for f in fixes]
        sender.curve("plots/gps/pdop", times, pdop, YELLOW, "position dilution")


def instruments(sender, data):
    """The plots of the instruments."""
    for name, said in data.readings.items():
        step = plot_step(said.t_valid_s) if len(said.t_valid_s) else 1
        for plot in TABLE[name].plots if len(said.t_valid_s) else ():
            values, t_s = plot.values(said)[::step], said.t_valid_s[::step]
            entity = f"plots/{name}/{plot.name}"
            if values.ndim == 1:
                sender.readings(entity, t_s, values, BLUE, plot.title)
            else:
                for k, (axis, colour) in enumerate(AXES.items()):
                    sender.readings(f"{entity}/{axis}", t_s, values[:, k], colour, axis)


def ages(sender, data):
    """How old a measurement is when the computer has it, to 1 ns."""
    for name, records, colour in (("gps", data.gps, BLUE), ("star tracker", data.star_fixes, GREEN)):
        if records:
            age = [round(1e3 * (r.t_available_s - r.t_valid_s), 6) for r in records]
            entity = f"plots/age/{name.replace(' ', '_')}"
            sender.curve(entity, [r.t_available_s for r in records], age, colour, name)
    if len(data.frames.t_valid_s):
        frames = data.frames
        age = np.round(1e3 * (frames.t_available_s - frames.t_valid_s), 6)
        sender.curve("plots/age/frame", frames.t_available_s, age, WHITE, "frame read out")
