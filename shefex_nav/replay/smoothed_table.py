"""What smoothing a flight has changed: as an object for other programs, as a table for people."""

from shefex_nav.replay import compare
from shefex_nav.report import columns

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
        "parts": compare.compare(result.filtered, data) if has_truth else None,
    }


def too_sure(parts):
    """What to say of parts whose smoothed errors are far larger than their covariance says; '' if of none."""
    names = [row["part"] for row in parts if (row["nees"]["smoothed"] or 0.0) > TOO_SURE * DOF]
    if not names:
        return ""
    limit = f"NEES over {TOO_SURE * DOF:.0f}"
    return (
        f"{', '.join(names)}: smoothed errors are larger than their sigmas say ({limit}); errors that the "
        "filter does not know look like this, and lasting ones that it counts as noise"
    )


def table(summary):
    """rich Table: filtered and smoothed RMS by part of the flight."""
    what = "RMS errors in m, m/s and deg, filtered -> smoothed"
    title = f"{summary['scenario']}, seed {summary['seed']}: {what}"
    heads = ("part", ">from T, s", ">position", ">velocity", ">attitude", ">NEES of 9")
    found = columns.table(title, heads)
    for column in found.columns[:2]:
        column.no_wrap = True
    for row in summary["parts"]:
        cells = [f"{row['from_s']:+.1f}"]
        for name, digits in (("position_m", 2), ("velocity_m_s", 3), ("attitude_deg", 4)):
            before, after = row["filtered"][name], row["smoothed"][name]
            cells.append(f"{before:.{digits}f} -> {after:.{digits}f}")
        values = [row["nees"][which] for which in ("filtered", "smoothed")]
        cells.append("-" if None in values else f"{values[0]:.1f} -> {values[1]:.1f}")
        found.add_row(row["part"], *cells)
    return found
