"""Whether the filter knows how wrong it is: NEES, NIS, gates, faults noticed, protection level."""

import numpy as np

from shefex_nav.records import QUANTITIES, protected
from shefex_nav.report import trust
from shefex_nav.report.configured import configured
from shefex_nav.report.error_figures import BLOCKS
from shefex_nav.report.figures import style
from shefex_nav.report.navigation_errors import beside_covariance, chi2_bounds, navigation_errors
from shefex_nav.report.navigation_errors import nees as normalised

LEVEL = 0.95  # of the bounds
_DOUBTS = ((1, style.SKY, "level"), (2, style.RED, "contradicted"), (3, style.ORANGE, "IMU"))
_MOST_LANES = 12


def nees_of_blocks(data):
    """NEES at the epochs of the covariance: t_s (K,), {'position', 'velocity', 'attitude', 'all': (K,)}."""
    t_s, x, P = beside_covariance(data, navigation_errors(data))
    blocks = BLOCKS | {"all": slice(0, 9)}
    return t_s, {name: normalised(x[:, block], P[:, block, block]) for name, block in blocks.items()}


@style.styled
def nees(data):
    """NEES of position, velocity, attitude and all nine. RunData -> Figure; None without truth or sigmas."""
    if not len(data.covariance.t_s) or not len(data.truth.t_s):
        return None
    t_s, values = nees_of_blocks(data)
    if not any(np.isfinite(value).any() for value in values.values()):
        return None
    words = "NEES: squared error over what the covariance says, with where 95 % of epochs should lie"
    figure, rows = style.panels(data, len(values), words, height=1.5)
    for axes, (name, value) in zip(rows[:, 0], values.items(), strict=True):
        dof = 9 if name == "all" else 3
        low, high = chi2_bounds(dof, LEVEL)
        axes.axhspan(low, high, color=style.BAND, lw=0, label=f"{LEVEL:.0%} of χ² of {dof}")
        axes.axhline(dof, color=style.BLACK, lw=0.9, ls="--", label="expected mean")
        style.curve(axes, t_s, value, color=style.BLUE, lw=0.9, label="NEES")
        style.log_scale(axes, bottom=min(0.03, 0.5 * low), top=max(30.0, 2.0 * float(np.nanmax(value))))
        known = value[np.isfinite(value)]
        inside = float(np.mean((known >= low) & (known <= high)))
        axes.set_ylabel(name)
        style.note_above(axes, f"mean {np.mean(known):.2f}, {inside:.0%} of the epochs inside")
    style.legend_above(rows[0, 0])
    return figure


@style.styled
def nis(data):
    """NIS of every measurement by sensor, its gate, and refusals. RunData -> Figure; None without gates."""
    judged = [gate for gate in data.gates if gate.dof > 0 and np.isfinite(gate.nis)]
    sensors = sorted({gate.sensor for gate in judged})
    if not sensors:
        return None
    words = "NIS: squared surprise of each measurement, with 95 % bounds, gate and refusals"
    figure, rows = style.panels(data, len(sensors), words, height=1.7)
    for axes, sensor in zip(rows[:, 0], sensors, strict=True):
        _nis_of(axes, sensor, [gate for gate in judged if gate.sensor == sensor])
    return figure


def _nis_of(axes, sensor, gates):
    t_s = np.array([gate.t_valid_s for gate in gates])
    value, limit = np.array([gate.nis for gate in gates]), np.array([gate.limit for gate in gates])
    dof = np.array([gate.dof for gate in gates])
    accepted = np.array([gate.accepted for gate in gates])
    order = np.argsort(t_s, kind="stable")
    bounds = {n: chi2_bounds(n, LEVEL) for n in set(dof.tolist())}
    low, high = np.array([bounds[n] for n in dof.tolist()]).T
    times, low, high, edge = style.gapped(t_s[order], low[order], high[order], limit[order])
    axes.fill_between(times, low, high, color=style.BAND, lw=0, label=f"{LEVEL:.0%} of χ²")
    axes.plot(times, edge, color=style.BLACK, lw=1.0, ls="--", label="gate")
    style.dots(
        axes, t_s[accepted], value[accepted], ms=3.0, color=style.BLUE, label=f"used ({accepted.sum()})"
    )
    if not accepted.all():
        refused = ~accepted
        axes.plot(
            t_s[refused],
            value[refused],
            "x",
            ms=6,
            mew=1.6,
            color=style.RED,
            label=f"refused ({refused.sum()})",
        )
    top = float(np.nanmax(np.concatenate([value, limit[np.isfinite(limit)]])))
    style.log_scale(axes, bottom=max(1e-3, 0.5 * float(value[value > 0].min(initial=1.0))), top=2.0 * top)
    axes.set_ylabel(sensor.replace("_", " "))
    words = f"mean NIS per degree of freedom {np.sum(value) / np.sum(dof):.2f}"
    if not accepted.all():  # which lie above the gate: without them the mean flatters
        used = f"{np.sum(value[accepted]) / np.sum(dof[accepted]):.2f}" if accepted.any() else "none"
        words += f", refused ones too; of those used: {used}"
    style.note_above(axes, words)
    style.legend_above(axes, markerscale=1.5)


_LEVEL = ("horizontal", "vertical")
_PANELS = {"position": _LEVEL, "velocity": _LEVEL, "attitude": ("about x", "about y", "about z")}
_COLOURS = {"horizontal": style.SKY, "vertical": style.ORANGE}


def position_protection(data):
    """Protection level of the position, error, what is required. RunData -> Figure; None without levels."""
    return _protection(data, "position")


def velocity_protection(data):
    """As `position_protection`, of the velocity."""
    return _protection(data, "velocity")


def protection(data):
    """As `position_protection`, of the attitude."""
    return _protection(data, "attitude")


@style.styled
def _protection(data, quantity):
    """Protection level of a quantity, its error, what is required."""
    nav = data.nav
    if not trust.has_levels(nav):
        return None
    (unit, factor), names = trust.SHOWN[quantity], _PANELS[quantity]
    compared, said = trust.compare(data)[quantity], protected(nav, quantity)
    required = configured(data).limits.get(quantity)
    words = f"Protection level of the {quantity}, against the true error and what is required"
    figure, rows = style.panels(data, len(names), words)
    lowest = []
    for k, name in enumerate(names):
        axes, colour = rows[k, 0], _COLOURS.get(name) or style.AXES[name[-1]]
        for start, length in style.spans(nav.t_s, said.do_not_use):
            axes.axvspan(start, start + length, color="#eeeeee", lw=0, zorder=0)
        style.curve(axes, nav.t_s, factor * said.level[:, k], color=style.BLACK, label="protection level")
        if len(compared.t_s):
            error = factor * compared.error[:, k]
            style.curve(axes, compared.t_s, error, color=colour, lw=0.9, label="error")
            lowest.append(float(np.quantile(error, 0.05)))
        if required is not None:
            label = f"required, {factor * required:g} {unit}"
            axes.axhline(factor * required, color=style.RED, lw=1.3, ls="--", label=label)
        axes.set_ylabel(f"{name} [{unit}]")
    bottom = max(min(lowest, default=1e-3), 1e-4)
    for axes in rows[:, 0]:
        style.log_scale(axes, bottom=bottom, top=1.6 * axes.get_ylim()[1])
    rows[0, 0].fill_between([], [], color="#eeeeee", label="do not use")
    style.legend_above(rows[0, 0])
    return figure


@style.styled
def health(data):
    """What was out of order or refused, a lane for each source. RunData -> Figure; None if nothing was."""
    lanes, left = _lanes(data)
    if not lanes:
        return None
    words = "What the navigation noticed: sensors out of use, refusals, doubts"
    figure, rows = style.panels(data, 1, words, height=0.5 + 0.32 * len(lanes))
    axes, end_s = rows[0, 0], style.whole(data)[1]
    for k, (_, bars, marks, colour) in enumerate(lanes):
        least = 0.002 * (end_s - style.whole(data)[0])
        axes.broken_barh([(a, max(b, least)) for a, b in bars], (k - 0.32, 0.64), color=colour, lw=0)
        axes.plot(marks, np.full(len(marks), k), "x", ms=6, mew=1.6, color=style.RED)
    axes.set_yticks(range(len(lanes)), [lane[0] for lane in lanes], fontsize=9)
    axes.set_ylim(len(lanes) - 0.5, -0.5)
    if left:
        style.note_above(axes, f"not shown, for want of room: {', '.join(left)}")
    return figure


def _lanes(data):
    """(name, bars, marks, colour) of each lane; names of those for which there is no room."""
    end_s = style.whole(data)[1]
    out, left = [], []
    for quantity in QUANTITIES if len(data.nav.t_s) else ():
        for doubt, colour, name in _DOUBTS:
            bars = style.spans(data.nav.t_s, protected(data.nav, quantity).doubt == doubt)
            if bars:
                out.append((f"{quantity},\n{name}", bars, [], colour))
    found = trust.noticed(data.health)
    refused = {}
    for gate in data.gates:
        if not gate.accepted and gate.dof > 0:
            refused.setdefault(gate.sensor, []).append(gate.t_valid_s)
    for source in [*dict.fromkeys(entry["source"] for entry in found), *sorted(refused)]:
        name = source.replace("_", " ")
        if name in [lane[0] for lane in out]:
            continue
        if len(out) == _MOST_LANES:
            left += [name] * (name not in left)
            continue
        bars = [
            (entry["from_s"], (end_s if entry["until_s"] is None else entry["until_s"]) - entry["from_s"])
            for entry in found if entry["source"] == source
        ]  # fmt: skip
        out.append((name, bars, refused.get(source, []), style.GREY))
    return out, left
