"""Rows of the table about the star tracker: frames, fixes, their errors, and why frames gave none."""

import math

from rich.text import Text

from shefex_nav.report import sensor_use
from shefex_nav.report.error_figures import FAR
from shefex_nav.report.sizes import number, percent
from shefex_nav.report.star_metrics import WINDOW_RATE

TOO_FAST = f"faster than the window's {math.degrees(WINDOW_RATE):g} deg/s"
OFTEN = 0.5  # of the frames
MANY = 0.2  # of the frames: refused for one reason, which is explained


def star_rows(star):
    """(name, words) of what `metrics.summarise` has of the star tracker."""
    if not star["frames"]:
        yield "frames", "none taken"
        return
    share = f" ({percent(star['solved'] / star['in_window'])})" if star["in_window"] else ""
    yield "frames", f"{star['frames']}, of which {star['in_window']} in the window"
    yield "solved in the window", f"{star['solved']}{share}"
    if outside := star.get("outside"):
        beyond = star["fixes"] - star["solved"]
        solved = f"; {beyond} solved all the same" if beyond else ""
        none = star.get("no_fix_outside")
        none = f"; no fix: {_counted(none)}" if none else ""
        yield "outside it", f"{sum(outside.values())}: {_outside(outside)}{solved}{none}"
    yield "wrong", Text(str(star["wrong"]), style="bold red" if star["wrong"] else "")
    yield from _rate_rows(star["by_rate"])
    if star["no_fix"]:
        yield "no fix in the window", _counted(star["no_fix"])
        yield from _why(star)
    if (share := star.get("full_table_share")) is not None and share > OFTEN:
        words = f"as many as are kept, in {100.0 * share:.0f} % of the frames: fainter stars are left out"
        yield "objects", f"{words} (star_tracker.detection.most_objects)"
    error = star["error_arcsec"]
    mean = error.get("mean")
    across = None if mean is None else math.hypot(*mean[:2]) / math.sqrt(2.0)  # rms of two axes
    about = None if mean is None else abs(mean[2])
    for name, key, constant, of, per in (
        ("across", "cross_axis_rms", across, " (principal point)", " per axis"),
        ("about", "boresight_rms", about, "", ""),
    ):
        yield f"error {name} the boresight", _parts(error[key], constant, star["solved"], of, per)
    if (mounting := star.get("mounting_error_deg")) is not None:
        size = number(math.hypot(*mounting), 3, "deg")
        yield "mounting error", f"{size}, in the attitude of the body alone: not in the errors above"
    chain = star["chain_ms"]
    if chain["median"] is not None:
        median, p99 = (number(chain[key], 2, "ms") for key in ("median", "p99"))
        yield "time per frame", f"{median} median, 99 % below {p99}"


def _why(star):
    """What frames of the window need that are refused for one reason in large numbers."""
    for reason, words in (
        ("residuals", _of_residuals),
        ("too_few_stars", _of_few_stars),
        ("saturated", _of_saturated),
    ):
        if star["no_fix"].get(reason, 0) > MANY * star["frames"]:
            yield reason.replace("_", " "), Text(words(star), style="bold yellow")


def _of_residuals(_):
    words = "stars lie farther from their places than their centroids are said to be wrong by; "
    words = f"{words}are focal length and distortion of the lens as they are told "
    return f"{words}(navigation.told.star_camera.optics)? star_tracker.centroid_floor allows for it"


def _of_few_stars(star):
    objects = star.get("objects_without_fix")
    found = "" if objects is None else f"objects found in such a frame: {number(objects, 0)} (median); "
    return (
        f"{found}there is too little light (star_camera.optics, star_tracker.exposure.longest), or too small "
        "a field of view; `shefex-nav check` foresees both"
    )


def _of_saturated(star):
    mean, limit = (star.get("saturated_dn", {}).get(key) for key in ("median", "limit"))
    above = "star_tracker.exposure.brightest_mean"
    above = above if limit is None else f"{number(limit, 0, 'DN')} ({above})"
    is_above = "is" if mean is None else f"is {number(mean, 0, 'DN')} (median),"
    lower = "a smaller star_tracker.exposure.gain or shortest lowers it"
    return f"the mean grey value {is_above} above {above}: {lower}"


def _counted(counts):
    """{reason: count} in words."""
    return ", ".join(f"{count} {reason.replace('_', ' ')}" for reason, count in counts.items())


def _parts(rms, constant, n, of, per):
    """An error of n star fixes, arcsec, and how much of it is the run's mean. of : where that is from

    A single fix is its own mean and says nothing of the scatter; the mean of n takes a share of it, 1 / n.
    """
    if constant is None or rms is None or n < 2:
        return number(rms, 1, f'" rms{per}')
    scatter = math.sqrt(max(rms**2 - constant**2, 0.0) * n / (n - 1))
    return f'{number(rms, 1)}" rms{per}: constant {number(constant, 1)}"{of}, scatter {number(scatter, 1)}"'


def _outside(counts):
    """Why frames are out of the window, in words."""
    words = {"sun": "too near to the Sun", "sun_and_earth_limb": "to both Sun and Earth's limb"}
    words |= {"earth_limb": "to the Earth's limb"}
    words |= {"excluded": "too near to Sun or limb", "rate": TOO_FAST}  # a log that does not say to which
    near = next((name for name in words if name in counts), None)
    if near in ("sun_and_earth_limb", "earth_limb"):
        words[near] = f"too near {words[near]}"
    return ", ".join(f"{counts[name]} {words[name]}" for name in words if name in counts)


def _rate_rows(by_rate):
    """Success and errors against the true rate, of frames that were taken at more than one."""
    if len(by_rate) < 2:
        return
    rows = list(by_rate)
    while len(rows) > 1 and not (rows[-1]["solved"] or rows[-2]["solved"]):  # none is fixed: one row
        last = rows.pop()
        rows[-1] = rows[-1] | {"to_deg_s": last["to_deg_s"], "frames": rows[-1]["frames"] + last["frames"]}
    for row in rows:
        words = f"{row['solved']} of {row['frames']} solved"
        if row["wrong"]:
            words += f", {row['wrong']} wrong"
        if row["nees"] is not None:
            across, about = (row.get(f"{name}_scatter_arcsec") for name in ("cross_axis", "boresight"))
            words += f'; scatter {number(across, 1)}" across per axis, {number(about, 1)}" about; '
            words += f"NEES {number(row['nees'], 1)} of 3"
        yield f"at {rates(row)} deg/s", words


def rates(row):
    """Interval of rates of a row of `by_rate`, in words."""
    low, high = row["from_deg_s"], row["to_deg_s"]
    return f"more than {low:g}" if high is None else f"{low:g} to {high:g}"


TOO_SURE = 2.0  # NEES over its degrees of freedom from which on it is said in words
ODD = "bold yellow"


def uses_stars(navigation):
    """Whether a star fix was used, as far as is known. navigation : of the summary"""
    found = (navigation.get("measurements") or {}).items()
    used = [one["used"] for name, one in found if name.startswith("star")]
    return not used or any(one != 0 for one in used)


def of_sensors(navigation):
    """(name, text) of the measurements of GPS and star tracker, of what was on board."""
    for name, words, is_odd in sensor_use.rows(navigation.get("measurements") or {}):
        yield name, Text(words, style=ODD if is_odd else "")


def consistency_rows(navigation):
    """(name, text) of the NEES, of errors far beyond their sigmas, of what the errors fit."""
    nees = navigation["nees"]
    if nees["mean"] is not None:
        yield "NEES", _nees_words(nees)
    elif nees.get("why"):
        yield "NEES", nees["why"]
    if stretches := navigation.get("beyond_sigma"):
        yield "beyond sigma", Text(_beyond(stretches), style=ODD)
    for one in navigation.get("errors_fit") or ():
        yield "errors fit", Text(fit_words(one), style=ODD)
    for words in navigation.get("unknown") or ():
        yield "not known", words


def _beyond(stretches):
    """Since when which errors are far beyond their sigmas: the first stretch of each quantity."""
    first, said = {}, []
    for one in stretches:
        first.setdefault(one["quantity"], one)
    for one in sorted(first.values(), key=lambda one: one["from_s"]):
        end = "to the end" if one["until_s"] is None else f"to T{one['until_s']:+.1f} s"
        said.append(f"{one['quantity']} from T{one['from_s']:+.1f} s {end}, up to {times(one['times'])}")
    later = len(stretches) - len(first)
    more = f"; {later} more {'stretch' if later == 1 else 'stretches'} later" if later else ""
    return f"errors above {FAR:g} times their sigma: {'; '.join(said)}{more}"


def _nees_words(nees):
    """Errors over what the filter believes of them."""
    what = f"{number(nees['mean'], 1)} for {nees['dof']} degrees of freedom, {nees['samples']} epochs"
    if nees.get("why"):
        what = f"{what} {nees['why']}"
    if nees["mean"] <= TOO_SURE * nees["dof"]:
        return what
    return Text(f"{what}: errors are larger than the filter's sigmas say{_times(nees)}", style=ODD)


def _times(nees):
    """How many times larger those of each block are."""
    said = [
        f"{name} {times(one)}" for name, one in (nees.get("times_sigma") or {}).items() if one is not None
    ]
    return f": {', '.join(said)} (1 would be right)" if said else ""


def times(ratio):
    """A ratio of errors and sigmas, for people."""
    return f"{number(ratio, 1 if ratio < 10.0 else 0)} times"


def beyond_words(one):
    """A Beyond, for people."""
    return f"{one.quantity} error up to {times(one.times)} the sigma that the solution reports"


def fit_words(one):
    """An entry of `errors_fit`, for people."""
    return f"{one['what']}; T{one['from_s']:+.1f} to {one['until_s']:+.1f} s"
