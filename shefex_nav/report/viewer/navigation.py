"""What the viewer shows of the navigation: errors, consistency, trust."""

import numpy as np

from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.instruments import TABLE
from shefex_nav.late_packages import special
from shefex_nav.records import QUANTITIES, Doubt, protected
from shefex_nav.report import trust
from shefex_nav.report.navigation_errors import NEES_DOF, navigation_errors, normalised_errors
from shefex_nav.report.viewer import layout, world
from shefex_nav.report.viewer.sender import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    RED,
    VIOLET,
    YELLOW,
    plot_step,
    plotted,
)

CONFIDENCE = 0.95  # of the bounds of NEES
THIN = 0.7  # width of errors: they swing with the spin, a thick line is a block of colour
WINDOW, TURNS = 10, 3  # points of a piece of a curve, turns in it of one that swings
_SENSORS = {  # colour of what it accepted; of instruments grey
    "gps_position": BLUE,
    "gps_velocity": VIOLET,
    "star_tracker": GREEN,
}


def send(sender, data):
    """Everything of one run."""
    errors(sender, data)
    biases(sender, data)
    consistency(sender, data)
    trusted(sender, data)


def errors(sender, data, run="", colours=(BLUE, RED)):
    """Error of every axis inside plus and minus three of its logged standard deviations.

    run : name of the run where there are several; colours : of its error and of its sigmas
    """
    found = navigation_errors(data)
    sigma_t_s, _, sigma = normalised_errors(data, found)
    nine = np.hstack([found.position_i, found.velocity_i, np.degrees(found.attitude_b)])
    sigma = np.hstack([sigma[:, :6], np.degrees(sigma[:, 6:])])
    suffix = f" {run}" if run else ""
    for k, plot in enumerate(layout.ERROR_PLOTS):
        folder = f"{plot.entity}/{run}" if run else plot.entity
        rows = plotted(sigma_t_s, sigma[:, k])
        at_s, three = sigma_t_s[rows], 3.0 * sigma[rows, k]
        for sign, name, side in ((1.0, "+3 sigma", "plus"), (-1.0, "-3 sigma", "minus")):
            sender.curve(f"{folder}/{side}", at_s, sign * three, colours[1], name + suffix)
        rows = plotted(found.t_s, nine[:, k])
        at_s, error = found.t_s[rows], nine[rows, k]
        if run:
            _outlined(sender, f"{folder}/error", at_s, error, colours[0], f"error{suffix}")
        else:
            sender.curve(f"{folder}/error", at_s, error, colours[0], "error", THIN)


def _outlined(sender, entity, t_s, values, colour, name):
    """A curve over those of another run: where it swings to and fro its edges, which hide nothing."""
    line, middle_s, edges = outline(t_s, values)
    sender.curve(entity, t_s, line, colour, name, THIN)
    for edge, word in zip(edges, ("least", "most"), strict=True):
        if np.isfinite(edge).any():
            sender.curve(f"{entity}_{word}", middle_s, edge, colour, f"{name}, {word} of each second", THIN)


def outline(t_s, values):
    """A curve that is a solid block where it swings to and fro, as a line and two edges.

    t_s, values : (N,) some ten points a second

    Returns
    -------
    line : (N,) NaN inside of pieces that swing
    middle_s : (M,) of the pieces, WINDOW points each
    edges : (2, M) least and largest value of those that swing, else NaN
    """
    n = len(values) // WINDOW
    pieces = values[: n * WINDOW].reshape(n, WINDOW)
    with np.errstate(invalid="ignore"):
        steps = np.sign(np.diff(pieces, axis=1))
    swings = (steps[:, 1:] * steps[:, :-1] < 0.0).sum(axis=1) >= TURNS
    edges = np.where(swings, [pieces.min(axis=1), pieces.max(axis=1)], np.nan) if n else np.zeros((2, 0))
    line = values.copy()
    inside = np.zeros(len(values), bool)
    inside[: n * WINDOW] = np.repeat(swings, WINDOW)
    line[inside] = np.nan
    middle_s = t_s[: n * WINDOW].reshape(n, WINDOW).mean(axis=1) if n else t_s[:0]
    return line, middle_s, edges


def biases(sender, data):
    """Estimated biases with three standard deviations about them; the log does not have the true ones."""
    covariance = data.covariance
    if not len(covariance.t_s):
        return
    step = plot_step(covariance.t_s)
    t_s, sigma = covariance.t_s[::step], covariance.sigma[::step]
    for name, values, columns, unit in (
        ("gyro_bias", covariance.gyro_bias, slice(0, 3), np.degrees(3600.0)),  # deg/h
        ("accel_bias", covariance.accel_bias, slice(3, 6), 1e3 / STANDARD_GRAVITY),  # mg
    ):
        value, band = values[::step] * unit, 3.0 * sigma[:, columns] * unit
        for k, axis in enumerate("xyz"):
            entity = f"plots/biases/{name}_{axis}"
            sender.curve(f"{entity}/plus", t_s, value[:, k] + band[:, k], RED, "+3 sigma")
            sender.curve(f"{entity}/minus", t_s, value[:, k] - band[:, k], RED, "-3 sigma")
            sender.curve(f"{entity}/estimate", t_s, value[:, k], BLUE, "estimate")


def consistency(sender, data, run="", colour=BLUE):
    """NEES with its bounds, and every measurement's NIS by its limit: refused above one."""
    t_s, nees, _ = normalised_errors(data, navigation_errors(data))
    rows = plotted(t_s, nees)
    entity = f"plots/nees/{run or 'run'}"
    sender.curve(entity, t_s[rows], nees[rows], colour, f"NEES {run}".strip())
    if run:
        return
    tail = 0.5 * (1.0 - CONFIDENCE)
    ends = t_s[[0, -1]] if len(t_s) else []
    for name, share in (("lower", tail), ("upper", 1.0 - tail)):
        limit = float(special().chdtri(NEES_DOF, 1.0 - share))
        sender.curve(f"plots/nees/{name}", ends, [limit] * len(ends), RED, f"{name} bound, {CONFIDENCE:.0%}")
    for sensor in sorted({gate.sensor for gate in data.gates}):
        _innovations(sender, sensor, [gate for gate in data.gates if gate.sensor == sensor])


def _innovations(sender, sensor, gates):
    t_s = np.array([gate.t_s for gate in gates])
    share = np.array([gate.nis / gate.limit if gate.limit else np.nan for gate in gates])
    accepted = np.array([gate.accepted for gate in gates])
    known = np.isfinite(share)
    entity, name = f"plots/nis/{sensor}", sensor.replace("_", " ")
    colour = _SENSORS.get(sensor, GREY if sensor in TABLE else YELLOW)
    used = accepted & known
    sender.marks(f"{entity}/used", t_s[used], share[used], colour, f"{name}, used")
    refused = ~accepted & known  # what has no NIS, such as no fix, is in the states
    if refused.any():
        shown = share[refused].clip(0.0, layout.MOST_NIS)
        sender.marks(f"{entity}/refused", t_s[refused], shown, ORANGE, f"{name}, refused", "cross", 4.0)


def trusted(sender, data):
    """Protection levels against the errors, whether to use the solution, the health of the sensors."""
    nav = data.nav
    if trust.has_levels(nav):
        compared = trust.compare(data)
        for quantity in QUANTITIES:
            _protection(sender, data, quantity, compared[quantity])
    for source in sorted({record.source for record in data.health}):
        records = [record for record in data.health if record.source == source]
        states = ["good" if record.healthy else record.reason for record in records]
        colours = {"good": GREEN} | {state: ORANGE for state in states if state != "good"}
        times, entity = [record.t_s for record in records], f"states/health/{source.replace(' ', '_')}"
        if not sender.has_lane(entity):
            times, states = [data.mission.start_s, *times], ["good", *states]
        sender.lane(entity, times, states, {**colours, "": GREY}, world.time_span(data))


def _protection(sender, data, quantity, compared):
    """Protection level of one quantity, its error along the worst axis, and whether to use it."""
    nav, said, factor = data.nav, protected(data.nav, quantity), trust.UNITS[quantity][1]
    step, entity = plot_step(nav.t_s), f"plots/protection/{quantity}"
    level = factor * said.level[::step]
    if quantity == "attitude":
        sender.axes(f"{entity}/level", nav.t_s[::step], level)
    else:
        for k, (name, colour) in enumerate((("horizontal", GREEN), ("vertical", YELLOW))):
            sender.curve(f"{entity}/{name}", nav.t_s[::step], level[:, k], colour, f"level, {name}")
    worst = factor * compared.error.max(axis=1) if len(compared.t_s) else np.zeros(0)
    rows = plotted(compared.t_s, worst)
    sender.curve(f"{entity}/error", compared.t_s[rows], worst[rows], (240, 240, 240), "error, worst axis")
    words = {int(doubt): f"do not use: {doubt.name.lower()}" for doubt in Doubt}
    words[int(Doubt.NONE)] = "usable"
    colours = {word: GREEN if word == "usable" else ORANGE for word in words.values()}
    changes = np.flatnonzero(np.diff(said.doubt, prepend=-1))
    states = [words[int(d)] for d in said.doubt[changes]]
    sender.lane(f"states/solution/{quantity}", nav.t_s[changes], states, colours, world.time_span(data))
