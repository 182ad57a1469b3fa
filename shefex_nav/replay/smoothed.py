"""What a smoothed flight leaves: a log for `report` and `view`, and what it has changed."""

from itertools import chain
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.clock import SAME_S
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.topics import SMOOTHED, RunSummary
from shefex_nav.log.writer import LogWriter
from shefex_nav.onboard.navigation.quantity import ATTITUDE, about
from shefex_nav.records import Phase
from shefex_nav.replay.rerun import Recording, not_seen_on_board, timed
from shefex_nav.report import columns, metrics
from shefex_nav.report.navigation_errors import NEES_DOF, navigation_errors, normalised_errors
from shefex_nav.report.track import earth_fixed

NO_PICTURES = FramePolicy(0, "none", 4.0)
DOF = 9  # of the NEES of position, velocity and attitude
TOO_SURE = 2.0  # [E] times as much as is expected: a remark


def summarise(log, path, result, wall_s):
    """Object of numbers, texts and None; 'parts' is None without truth.

    log, path : that was smoothed, that was written;  result : smooth.Smoothed;  wall_s : how long it took
    """
    data = result.smoothed
    has_truth = len(data.truth.t_s) > 0
    return {
        "scenario": data.mission.scenario,
        "seed": data.mission.seed,
        "log": str(log),
        "smoothed": str(path),
        "ended_early": data.ended_early,
        "wall_s": wall_s,
        "real_time_factor": float(data.nav.t_s[-1] - data.nav.t_s[0]) / wall_s,
        "parts": compare(result.filtered, data) if has_truth else None,
    }


def too_sure(parts):
    """What to say of parts whose smoothed errors are far larger than their covariance says; '' if of none."""
    names = [part["part"] for part in parts if (part["nees"]["smoothed"] or 0.0) > TOO_SURE * DOF]
    if not names:
        return ""
    limit = f"NEES over {TOO_SURE * DOF:.0f}"
    return (
        f"{', '.join(names)}: smoothed errors are larger than their sigmas say ({limit}); errors that the "
        "filter does not know look like this, and lasting ones that it counts as noise"
    )


def table(summary, title):
    """rich Table: filtered and smoothed RMS by part of the flight `title`."""
    title = f"{title}: RMS errors in m, m/s and deg, filtered -> smoothed"
    heads = ("part", ">from T, s", ">position", ">velocity", ">attitude", ">NEES of 9")
    found = columns.table(title, heads)
    for column in found.columns[:2]:
        column.no_wrap = True
    for part in summary["parts"]:
        cells = [f"{part['from_s']:+.1f}"]
        for name, digits in (("position_m", 2), ("velocity_m_s", 3), ("attitude_deg", 4)):
            before, after = part["filtered"][name], part["smoothed"][name]
            cells.append(f"{before:.{digits}f} -> {after:.{digits}f}")
        values = [part["nees"][which] for which in ("filtered", "smoothed")]
        cells.append("-" if None in values else f"{values[0]:.1f} -> {values[1]:.1f}")
        found.add_row(part["part"], *cells)
    return found


# ----------------------------------------------------------------------------------------------------------
# How much better one navigation solution is than another, part of the flight by part of the flight.


QUANTITIES = ("position_m", "velocity_m_s", "attitude_deg")


class Part(NamedTuple):
    """A part of the flight; ends belong to it."""

    name: str
    from_s: float
    to_s: float


def parts(data):
    """Parts of a flight that a RunData covers, in order of time; 'middle of the stars' lies in 'stars'.

    Boost is from lift-off to the last burn-out, or as far as the log goes; stars are from the first fix that
    the filter used to the last, their middle is the middle third; entry is the first descent through 100 km.
    """
    times = {}
    for event in data.events:
        name = "burn_out" if event.name.startswith("burn_out") else event.name
        times[name] = event.t_s
    start_s, end_s = (float(t_s) for t_s in data.truth.t_s[[0, -1]])
    k = metrics.entry_index(earth_fixed(data.mission.earth, data.truth).height)
    entry_s = end_s if k is None else float(data.truth.t_s[k])
    lift_s = times.get("lift_off", start_s)
    burning_s = data.truth.t_s[data.truth.phase == Phase.BOOST]  # a log may end before the motor does
    burnt_s = max(times.get("burn_out", lift_s), *burning_s[-1:].tolist(), lift_s)
    used = [gate.t_valid_s for gate in data.gates if gate.accepted and about(gate.sensor) is ATTITUDE]
    first_s, last_s = (min(used), max(used)) if used else (entry_s, entry_s)
    third_s = (last_s - first_s) / 3.0
    found = (
        Part("before lift-off", start_s, lift_s),
        Part("boost", lift_s, burnt_s),
        Part("before stars" if used else "coast" if "lift_off" in times else "all", burnt_s, first_s),
        Part("stars", first_s, last_s),
        Part("middle of the stars", first_s + third_s, last_s - third_s),
        Part("after stars", last_s, entry_s),
        Part("at entry", entry_s, entry_s),
        Part("after entry", entry_s, end_s),
    )
    return [part for part in found if part.to_s > part.from_s or (part.name == "at entry" and k is not None)]


def compare(filtered, smoothed):
    """RMS errors of two solutions of one flight by its parts.

    RunData, RunData with truth -> list of dict: part, from_s, to_s, filtered, smoothed, ratio, each with the
    QUANTITIES, and nees of both: mean of nine degrees of freedom. What has no sample is None.
    """
    errors = [_norms(data) for data in (filtered, smoothed)]
    result = []
    for part in parts(filtered):
        said = {"part": part.name, "from_s": part.from_s, "to_s": part.to_s}
        rms, nees = zip(*(_in(part, *error) for error in errors), strict=True)
        for name, values in zip(("filtered", "smoothed"), rms, strict=True):
            said[name] = dict(zip(QUANTITIES, values, strict=True))
        said["ratio"] = dict(zip(QUANTITIES, map(_ratio, *rms), strict=True))
        said["nees"] = {"filtered": nees[0], "smoothed": nees[1], "dof": NEES_DOF}
        if rms[0][0] is not None:
            result.append(said)
    return result


def _norms(data):
    """t_s (N,), position m, velocity m/s, attitude deg (N, 3), and t_s (K,), NEES (K,) of a RunData."""
    errors = navigation_errors(data)
    norms = np.column_stack(
        [np.linalg.norm(e, axis=1) for e in (errors.position_i, errors.velocity_i, errors.attitude_b)]
    )
    norms[:, 2] = np.degrees(norms[:, 2])
    t_s, nees, _ = normalised_errors(data, errors)
    return errors.t_s, norms, t_s, nees


def _in(part, t_s, norms, nees_t_s, nees):
    """RMS of each quantity in a part, and mean NEES; None where there is no sample."""
    inside, known = (
        (times >= part.from_s - SAME_S) & (times <= part.to_s + SAME_S) for times in (t_s, nees_t_s)
    )
    rms = np.sqrt((norms[inside] ** 2).mean(axis=0)).tolist() if inside.any() else [None] * len(QUANTITIES)
    return rms, float(nees[known].mean()) if known.any() else None


def _ratio(before, after):
    return after / before if before and after is not None else None


def write(path, recording: Recording, smoothed, wall_s, *, overwrite=False):
    """Write the log.

    Parameters
    ----------
    path : file
    recording : Recording that was smoothed
    smoothed : RunData
    wall_s : how long it took
    overwrite : a file that exists is lost
    """
    mission = smoothed.mission._replace(
        scenario=SMOOTHED.format(smoothed.mission.scenario),
        scenario_text=recording.scenario_text,
        version=__version__,
    )
    end_s = float(smoothed.nav.t_s[-1])
    with LogWriter(path, mission, NO_PICTURES, overwrite=overwrite) as log:
        for record in records(smoothed):
            log.write(record)
        log.write(RunSummary(end_s, wall_s, 0.0, smoothed.cut_s))


def records(data):
    """Records of a RunData in order of time, without the pixels and the IMU: a generator."""
    if data.alignment is not None:
        yield data.alignment
    pairs = not_seen_on_board(data)
    lists = [data.gps, data.gps_ranges, data.star_fixes, data.gates]
    pairs += [(record.t_valid_s, record) for record in chain(*lists)]
    for arrays in data.readings.values():
        pairs += timed(arrays, "t_valid_s")
    pairs += [(record.t_s, record) for record in data.health]
    for arrays in (data.nav, data.covariance, data.compute_times):
        pairs += timed(arrays)
    for _, record in sorted(pairs, key=lambda pair: pair[0]):
        yield record
