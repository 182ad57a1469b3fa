"""Allan deviation of every IMU of the package, drawn, against the formula and the data sheet.

uv run python benchmarks/allan.py [--out allan.png] [--times 100] [NAME ...]

Draws a unit at rest with the error model of the simulation, at a low rate, for `--times` its longest
averaging time (1.5 times that of its lowest point). Prints random walk and lowest point over what the file
has, and draws one panel for gyros and one for accelerometers: lines are drawn series, dots the data sheet's
floors.
"""

import argparse
import math
from typing import NamedTuple

import numpy as np

from shefex_nav.settings import changed
from shefex_nav.world import allan, imu

G = 9.80665
UNITS = {"gyro": ("deg/h", math.radians(1.0) / 3600.0), "accelerometer": ("µg", 1e-6 * G)}
GRID = 30  # averaging times


class Still(NamedTuple):
    """A unit at rest, as `imu.measure` wants a trajectory; row 0 is before the first sample."""

    t_s: np.ndarray  # (n + 1,)
    burning: np.ndarray  # (n + 1,) 0: no stage
    dtheta_b: np.ndarray  # (n + 1, 3) rad, zero
    dv_b: np.ndarray  # (n + 1, 3) m/s, zero


def at_rest(settings, n, dt_s, rng):
    """What a unit reports in n samples of any length without motion, gravity and vibration.

    settings : settings.Imu;  rng : Generator -> (n, 3) rad, (n, 3) m/s
    """
    calm = {"boost": (0.0,), "coast": 0.0, "angular": 0.0,
            "lowest_frequency": 1e-6 / dt_s, "highest_frequency": 1.0 / dt_s}  # fmt: skip
    settings = changed(settings, {f"vibration.{key}": value for key, value in calm.items()})
    nothing = np.zeros((n + 1, 3))
    still = Still(np.arange(n + 1) * dt_s, np.zeros(n + 1, dtype=int), nothing, nothing)
    data = imu.measure(settings, still, rng)
    return data.dtheta_b[1:], data.dv_b[1:]


def measured(increments, dt_s, tau_s):
    """Overlapping Allan deviation of a series.

    Parameters
    ----------
    increments : (n, m) integrals of rate or specific force over samples of dt_s, a series a column
    tau_s : averaging times, rounded to whole samples

    Returns
    -------
    tau_s : (k,) s, as taken
    deviation : (k, m)
    """
    phase = np.concatenate([np.zeros((1, increments.shape[1])), np.cumsum(increments, axis=0)])
    counts = np.unique(np.maximum(1, np.rint(np.asarray(tau_s) / dt_s).astype(int)))
    found = [
        np.sqrt(0.5 * np.mean((phase[2 * k :] - 2.0 * phase[k:-k] + phase[: -2 * k]) ** 2, axis=0))
        / (k * dt_s)
        for k in counts
    ]
    return counts * dt_s, np.array(found)


def drawn(name, times):
    """Of each triad of a unit: {triad: (averaging times, deviation, settings, floor of the file or None)}."""
    from shefex_nav.scenario import instruments
    from shefex_nav.scenario.load import load, load_as
    from shefex_nav.scenario.of_settings import settings

    file, _, _ = load_as(lambda provided: instruments.SECTIONS["imu",], instruments.files()[name])
    own, rng, found = settings(load("shefex2_andoya", [f"imu.use={name}"]).imu), np.random.default_rng(7), {}
    for column, triad in enumerate(UNITS):
        part = getattr(own, triad)
        _, at_s = allan.floor(part)
        longest_s, dt_s = min(1.5 * at_s, allan.PEAK * part.in_run_bias_time), at_s / 40.0
        series = at_rest(own, math.ceil(times * longest_s / dt_s), dt_s, rng)[column]
        tau_s, each = measured(series, dt_s, np.geomspace(dt_s, longest_s, GRID))
        found[triad] = tau_s, np.sqrt(np.mean(each**2, axis=1)), part, getattr(file.floor, triad)
    return found


def main():
    """Print the table and draw the picture."""
    from shefex_nav.scenario import instruments

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", default="allan.png")
    parser.add_argument("--times", type=float, default=100.0)
    given = parser.parse_args()
    names = given.names or [one.name for one in instruments.listed() if one.instrument == "imu"]
    found = {name: drawn(name, given.times) for name in names}
    print(f"{'unit':14s} {'triad':14s} {'random walk':>11s} {'floor':>14s} {'at':>8s} {'of the file':>11s}")
    for name, triads in found.items():
        for triad, (tau_s, curve, part, sheet) in triads.items():
            unit, scale = UNITS[triad]
            walk = curve[0] * math.sqrt(tau_s[0]) / part.random_walk
            share = f"{curve.min() / sheet:.2f}" if sheet else f"({curve.min() / allan.floor(part)[0]:.2f})"
            at = f"{curve.min() / scale:.3g} {unit:5s} {tau_s[curve.argmin()]:6.0f} s"
            print(f"{name:14s} {triad:14s} {walk:11.3f} {at:>23s} {share:>11s}")
    print("(in brackets: of the formula, where the data sheet gives none)")
    draw(found, given.out)


def draw(found, path):
    """The picture."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, panels = pyplot.subplots(1, 2, figsize=(13, 6), layout="constrained")
    colours = pyplot.get_cmap("tab20")
    for panel, (triad, (unit, scale)) in zip(panels, UNITS.items(), strict=True):
        for k, (name, triads) in enumerate(found.items()):
            tau_s, curve, _, sheet = triads[triad]
            panel.loglog(tau_s, curve / scale, color=colours(k % 20), label=name)
            if sheet:
                panel.plot(tau_s[curve.argmin()], sheet / scale, "o", color=colours(k % 20))
        panel.set(xlabel="averaging time, s", ylabel=f"Allan deviation of the {triad}, {unit}")
        panel.grid(which="both", alpha=0.3)
    panels[1].legend(fontsize="small", ncols=2)
    figure.savefig(path, dpi=120)
    print(path)


if __name__ == "__main__":
    main()
