"""The closing table of a run, for people."""

from rich.text import Text

from shefex_nav import event_words
from shefex_nav.log.topics import SMOOTHED
from shefex_nav.records import QUANTITIES
from shefex_nav.report import columns, innovations, local_level, requirements, table_rows, trust
from shefex_nav.report.sizes import number, percent

_FLOWN = (  # name, key, digits, unit
    ("apogee", "apogee_km", 1, "km"),
    ("range", "range_km", 1, "km"),
    ("highest speed", "max_speed_m_s", 0, "m/s"),
)
_ERRORS = (
    ("position error", "position_error_m", 1, "m"),
    ("velocity error", "velocity_error_m_s", 3, "m/s"),
    ("attitude error", "attitude_error_deg", 3, "deg"),
)
MOST_FAULTS = 12  # in the table
HALF_TURN_DEG = 180.0


def _pair(values, digits, unit):
    return f"{number(values['rms'], digits, unit)} rms, {number(values['max'], digits, unit)} max"


def summary_table(summary, judged=()):
    """rich Table of the object that `metrics.summarise` returns, and of the requirements.Judged of a run."""
    every = ((section, *line) for section, lines in rows(summary, judged) for line in lines)
    return columns.sections(local_level.title_of(summary), every)


def rows(summary, judged=()):
    """(section, lines of name and value) of the summary, as texts."""
    yield "flight", _flight_rows(summary["flight"], stood=bool(summary["simulated_s"]))
    if summary["attitude_control"]:
        yield "attitude control", _control_rows(summary["attitude_control"])
    own = summary["software"]
    yield "star tracker", [*_own_rows(own, "star_tracker"), *table_rows.star_rows(summary["star_tracker"])]
    of = "computer" if "computer" in own else "navigation"
    smoothed = _smoothed_rows(summary["scenario"])
    yield "navigation", [*_own_rows(own, of), *_navigation_rows(summary["navigation"]), *smoothed]
    if judged:
        is_part = summary["ended_early"] or summary["until_s"] is not None
        both = [
            (f"{quantity}, met and not usable", words) for quantity, words in trust.vouched(summary, judged)
        ]
        yield "requirements", [*_requirement_rows(judged, is_part), *both]
    if told := summary.get("told_otherwise"):
        lines = [(one["field"].removeprefix("navigation.told."), one["text"]) for one in told]
        yield "told otherwise", lines
    if summary["warnings"]:
        yield (
            "warnings",
            ((one["field"], Text(one["text"], style="bold yellow")) for one in summary["warnings"]),
        )
    if "alignment" in summary:
        yield "alignment", alignment(summary["alignment"])
        yield "clocks", clocks(summary["clocks"])
    if summary.get("barometer"):
        yield "barometer", barometer(summary["barometer"])
    if summary.get("real_time"):
        yield "real time", _real_time_rows(summary["real_time"])
    yield "run", _run_rows(summary)


def _requirement_rows(judged, is_part):
    """is_part: whether the mission was not seen to its end, and what has no figure may be yet to come."""
    for one in judged:
        verdict = requirements.verdict(one, is_part)
        style = "bold red" if verdict.startswith("not met") else ""
        said = (
            f"{requirements.in_words(one)}, wanted {requirements.words(one.name, one.required, one.unit)}: "
        )
        yield one.name.replace("_", " "), Text.assemble(said, Text(verdict, style=style))


def _flight_rows(flight, *, stood):
    estimated = flight["of"] == "solution"
    if flight["climbs_at_km"] is not None:
        climbs = number(flight["climbs_at_km"], 1, "km")
        yield "height at the end", f"{climbs} above the ellipsoid, no apogee before it"
    elif (heights := flight.get("height_km")) and heights["max"] != flight["apogee_km"]:  # no launch
        low, high = (number(heights[key], 1) for key in ("min", "max"))
        yield "height", f"{low} to {high} km above the ellipsoid"
    for name, key, digits, unit in _FLOWN:
        if flight[key] is not None:
            above = " above the ellipsoid" if key == "apogee_km" else ""
            yield name, f"{number(flight[key], digits, unit)}{above}"
    if flight.get("at_impact"):
        yield "impact at", place(flight["at_impact"])
    if stood and flight["max_speed_m_s"] is None:
        yield "motion", "none beyond the errors" if estimated else "none, it stands on the ground"
    if stood and estimated:
        true_s = flight.get("truth_s")
        words = "the truth is of T{:+.1f} to {:+.1f} s alone" if true_s else "there is no truth"
        yield "as estimated", words.format(*true_s or ())
    for event in flight["events"]:
        when = f"T{event['t_s']:+.1f} s, {number(event['altitude_km'], 1, 'km')}"
        yield event_words.in_words(event["name"]), when


def place(at, digits=4):
    """Latitude and longitude [deg] of a place of `flight`, for people."""
    latitude, longitude = at["latitude_deg"], at["longitude_deg"]
    north, east = "NS"[latitude < 0], "EW"[longitude < 0]
    return f"{abs(latitude):.{digits}f} {north}, {abs(longitude):.{digits}f} {east}"


def _control_rows(control):
    yield "cold gas used", number(control["propellant_kg"], 2, "kg")
    yield "pointing error while pointing", _pair(control["pointing_error_deg"], 2, "deg")


def _own_rows(software, section):
    """Software of a user's own that flew in a section."""
    if section in software:
        yield "software", software[section]


def _navigation_rows(navigation):
    share = navigation.get("solution_share")  # of an object of an earlier version there is none
    if share is not None and share < requirements.SOLVED and "measurements" in navigation:  # it flew
        words = f"at {100.0 * share:.1f} % of the ticks alone; errors and shares of the time are of these"
        yield "solution", Text(words, style="bold yellow")
    for name, key, digits, unit in _ERRORS:
        if navigation[key]["rms"] is not None:  # without truth there are none
            yield name, _pair(navigation[key], digits, unit)
    aided = navigation.get("star_aided")
    if aided and table_rows.uses_stars(navigation):
        words = f"{_pair(aided['attitude_deg'], 3, 'deg')}, T{aided['from_s']:+.1f} s to the end"
        yield "after two star fixes", words
    if pointing := navigation.get("while_pointing"):
        sizes = (("position_m", 1, "m"), ("velocity_m_s", 3, "m/s"), ("attitude_deg", 3, "deg about an axis"))
        largest = (number(pointing[key]["max"], digits, unit) for key, digits, unit in sizes)
        when = f"T{pointing['from_s']:+.0f} to {pointing['to_s']:+.0f} s"
        early = aided and table_rows.uses_stars(navigation) and pointing["from_s"] < aided["from_s"]
        early = f", star fixes since T{aided['from_s']:+.1f} s" if early else ""
        yield "while pointing", f"at most {', '.join(largest)}; {when}{early}"
    entry = navigation["at_entry"]
    if entry:
        axes = ", ".join(f"{angle:+.3f}" for angle in entry["attitude_error_deg"])
        yield (
            f"at {entry['altitude_km']:.0f} km, T{entry['t_s']:+.1f} s",
            (
                f"{number(entry['position_error_m'], 1, 'm')}, "
                f"{number(entry['velocity_error_m_s'], 3, 'm/s')}, "
                f"attitude x, y, z {axes} deg"
            ),
        )
    yield from table_rows.of_sensors(navigation)
    for name, counts in navigation.get("instruments", {}).items():
        words = f"{counts['used']} of {counts['readings']} readings used"
        doubtful = 2 * counts["used"] < counts["readings"]
        yield name.replace("_", " "), Text(words, style="bold yellow" if doubtful else "")
    yield from _integrity_rows(navigation["integrity"])
    if navigation.get("position_rms_ned_m"):
        yield from _level_rows(navigation)
    yield from innovations.rows(navigation.get("nis") or {})
    yield from table_rows.consistency_rows(navigation)


def _smoothed_rows(scenario):
    """What the log of a smoothed flight has of the filter on board. scenario : its name in the log"""
    if scenario.endswith(SMOOTHED.format("")):
        words = "protection levels, usable and do not use, measurements and NIS: not of the smoother"
        yield "as the filter said", words


def _integrity_rows(integrity):
    """When the solution may be used, and what was noticed; losses of GPS alone are too common to list."""
    if integrity is None:
        return
    for quantity in QUANTITIES:
        one = integrity[quantity]
        share, over = one["usable_share"], one["over_level"]
        largest = "" if over is None else f", error at most {number(over, 2)} of its protection level"
        yield f"{quantity} usable", f"{percent(share)} of the time{largest}{_doubts(quantity, one)}"
        if one["misleading_share"]:
            words = f"{percent(one['misleading_share'], 2)} of the time"
            yield f"{quantity} misleading", Text(words, style="bold red")
        if one["at_entry"]:
            yield f"{quantity} at entry", _entry_words(quantity, one)
    yield from loss_rows(integrity["noticed"])
    faults = _joined(integrity["noticed"])
    for entry in faults[:MOST_FAULTS]:
        yield _noticed_row(entry)
    if len(faults) > MOST_FAULTS:
        yield "and", f"{len(faults) - MOST_FAULTS} more, see --json"


def _joined(noticed):
    """What was noticed, without losses of GPS; what goes on after such a loss is one entry."""
    out, last = [], {}
    for entry in noticed:
        if is_loss(entry):
            continue
        before = last.get(entry["source"])
        lost = before is not None and before["reason"] == entry["reason"]
        if lost and _only_lost(noticed, before, entry):
            before["until_s"] = entry["until_s"]
            continue
        last[entry["source"]] = dict(entry)
        out.append(last[entry["source"]])
    return out


def _only_lost(noticed, before, entry):
    """Whether a source had nothing but losses from the end of one entry to the beginning of another."""
    gap = [
        one
        for one in noticed
        if one["source"] == entry["source"]
        and is_loss(one)
        and before["until_s"] - 1e-6 <= one["from_s"] < entry["from_s"]
    ]
    covered_s = sum(one["until_s"] - one["from_s"] for one in gap)
    return bool(gap) and covered_s > 0.5 * (entry["from_s"] - before["until_s"])


LEVELS = {  # quantity: key of its levels, how they are shown
    "position": ("protection_m", "{:.1f} m horizontal, {:.1f} m vertical"),
    "velocity": ("protection_m_s", "{:.2f} m/s horizontal, {:.2f} m/s vertical"),
    "attitude": ("protection_deg", "{:.3f}, {:.3f}, {:.3f} deg"),
}


def _entry_words(quantity, one):
    """Whether a quantity may be used at entry, and its protection level. one : of the integrity"""
    (key, form), entry = LEVELS[quantity], one["at_entry"]
    words = "usable" if entry["usable"] else f"do not use: {trust.doubt_of(quantity, entry['doubt'], one)}"
    known = None not in entry[key]
    if quantity == "attitude" and known and max(entry[key]) > HALF_TURN_DEG:
        known = False  # no attitude is farther off
    return f"{words}, protection level {form.format(*entry[key]) if known else 'unknown'}"


def _doubts(quantity, one):
    """Why a quantity was not usable: the two reasons that held longest."""
    longest = sorted(one["doubts"].items(), key=lambda one: -one[1])[:2]
    longest = [(name, share) for name, share in longest if share >= 5e-4]
    reasons = [f"{100.0 * share:.1f} %, {trust.doubt_of(quantity, name, one)}" for name, share in longest]
    return f"; not usable: {'; '.join(reasons)}" if reasons else ""


def _level_rows(navigation):
    """Errors in local level axes, and the same over their own sigmas."""
    since, over = f"rms from T{navigation['statistics_from_s']:+.0f} s", navigation["error_over_sigma"]
    for name, key, ratio, digits, unit in (
        ("position N, E, D", "position_rms_ned_m", "position_ned", 2, "m"),
        ("velocity N, E, D", "velocity_rms_ned_m_s", "velocity_ned", 3, "m/s"),
        ("roll, pitch, heading", "attitude_rms_rpy_deg", "attitude_rpy", 3, "deg"),
    ):
        values = ", ".join(f"{value:.{digits}f}" for value in navigation[key])
        has_sigmas = over and None not in over[ratio]
        sigmas = ", ".join(f"{value:.2f}" for value in over[ratio]) if has_sigmas else "-"
        yield name, f"{values} {unit} {since}, {sigmas} times the sigmas"


def _duration(duration_s):
    """Milliseconds, or seconds from one on, for people."""
    return number(duration_s, 2, "s") if duration_s >= 1.0 else number(1e3 * duration_s, 2, "ms")


def _real_time_rows(kept):
    yield (
        "pace",
        f"{kept['mission_s']:.1f} s of mission in {kept['elapsed_s']:.2f} s, {kept['pace']:g} wanted",
    )
    for name, key in (("ticks begin late by", "begin_late_s"), ("answer to a tick", "answer_s")):
        told = {word: _duration(value) for word, value in kept[key].items()}
        yield name, f"{told['median']} median, 99 % below {told['p99']}, {told['max']} at most"
    late = kept["late_answers"]
    share = f"{late} of {kept['ticks']}, longer than a tick"
    share += ": the software does not keep up" if 2 * late > kept["ticks"] else ""
    yield "late answers", Text(share, style="bold red" if late else "")


def _run_rows(summary):
    since = summary["simulated_from_s"]
    span = "" if since is None else f", from T{since:+.1f} s to T{since + summary['simulated_s']:+.1f} s"
    yield local_level.done(summary), number(summary["simulated_s"], 1, "s") + span
    if summary["wall_s"] is not None:
        is_slow = (summary["real_time_factor"] or 0.0) < 10.0
        factor = number(summary["real_time_factor"], 2 if is_slow else 0)
        yield "took", f"{number(summary['wall_s'], 1, 's')}, {factor} x real time"
    if summary["failure"]:
        yield (
            "failed",
            Text(f"{summary['failure'].splitlines()[0]}; everything above is up to then", style="bold red"),
        )
    elif summary["ended_early"]:
        words = "the run stopped before the end of the flight; everything above is up to there"
        yield "ended early", Text(words, style="bold yellow")
    if summary["until_s"] is not None:
        words = f"until T{summary['until_s']:+.1f} s; everything above is up to then"
        yield "looked at", Text(words, style="bold yellow")
    if summary["log"]:
        yield "log", summary["log"]


# ----------------------------------------------------------------------------------------------------------
# Losses of GPS: short ones are common, of a lasting one the table tells.


LASTING_S = 30.0  # [E] in all; antennas that turn away and ignitions cost a receiver some seconds
LOST = ("no fix", "no ranges")  # begins of reasons


def is_loss(entry):
    """Whether an entry of `trust.noticed` is a receiver without a solution."""
    return entry["reason"].startswith(LOST)


def loss_rows(noticed):
    """(source, words) of each receiver that was long without a solution. noticed : as of `trust.noticed`"""
    by_source = {}
    for entry in noticed:
        if is_loss(entry):
            by_source.setdefault(entry["source"], []).append(entry)
    for lost in by_source.values():
        lasting = [
            one for one in lost if one["until_s"] is None or one["until_s"] - one["from_s"] >= LASTING_S
        ]
        yield from map(_noticed_row, lasting)


def _noticed_row(entry):
    """(source, words) of an entry of `trust.noticed`."""
    until = "the end" if entry["until_s"] is None else f"T{entry['until_s']:+.1f} s"
    return entry["source"].replace("_", " "), f"T{entry['from_s']:+.1f} s to {until}: {entry['reason']}"


# ----------------------------------------------------------------------------------------------------------
# Lines of the closing table about the start of a replay: alignment and clocks.


def alignment(found):
    """(name, text) of the object that `replay.said.alignment` makes."""
    angles = ", ".join(f"{angle:.1f}" for angle in found["roll_pitch_heading_deg"])
    sigmas = ", ".join(f"{sigma:.2g}" for sigma in found["sigma_north_east_down_deg"])
    yield found["method"], f"roll, pitch, heading {angles} deg at T{found['t_s']:+.1f} s"
    yield "1 sigma", f"{sigmas} deg about north, east, down"
    if found["searched_from_s"] is not None:
        since = f"not known at T{found['searched_from_s']:+.1f} s"
        yield "found in motion", f"{since}; the navigation begins where it was found"
    if found["gyro_bias_deg_s"]:
        bias = ", ".join(f"{rate:.3g}" for rate in found["gyro_bias_deg_s"])
        yield "gyro bias", f"{bias} deg/s, 1 sigma {found['sigma_gyro_bias_deg_s']:.2g} deg/s"


def clocks(found):
    """(name, text) of the object that `replay.said.clocks` makes; nothing where nothing is known."""
    if found["found_s"] is not None:
        seen = f"{1e3 * found['found_s']:+.1f} ms, 1 sigma {1e3 * found['sigma_s']:.1f} ms"
        yield "fixes are stamped", f"{seen}, later than the IMU has them, by comparing their motions"
    if found["applied_s"]:
        yield "corrected by", f"{1e3 * found['applied_s']:+.1f} ms, taken from the times of GNSS"
    if found["gps_latency_s"] is not None:
        seen = f"{1e3 * found['gps_latency_s']:+.1f} ms, 1 sigma {1e3 * found['sigma_gps_latency_s']:.1f} ms"
        yield "by the filter", f"fixes are {seen}, older than their times"


def barometer(found):
    """(name, text) of the object that `replay.replayed.highest` makes."""
    words = f"{found['pressure_altitude_m']:.0f} m above the start at T{found['t_s']:+.1f} s"
    yield "pressure altitude", f"{words}, by the standard atmosphere"
    yield (
        "height there",
        f"{found['height_m']:.0f} m above the start, 1 sigma {found['sigma_height_m']:.0f} m",
    )
    if found["warmer_by"] is not None:
        share = f"{100.0 * found['warmer_by']:+.1f} %, 1 sigma {100.0 * found['sigma_warmer_by']:.1f} %"
        yield "air below", f"warmer than the standard by {share}"
