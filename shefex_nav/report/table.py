"""The closing table of a run, for people."""

from rich.text import Text

from shefex_nav import event_words
from shefex_nav.instruments import TABLE
from shefex_nav.records import QUANTITIES
from shefex_nav.report import columns, requirements, start_rows

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
DOUBTS = {  # records.Doubt for people
    "level": "protection level above requirements.{quantity}.limit",
    "contradicted": "contradicted by a sensor",
    "imu": "motion beyond the IMU's range",
}
MANY = 0.2  # of the frames: refused for one reason, which is explained
TOO_SURE = 2.0  # NEES over its degrees of freedom from which on it is said in words
FAST_DEG_S = 3.0  # beyond this a star tracker is made for turns


def number(value, digits, unit=""):
    """A figure with its unit, for people; '-' of None."""
    return "-" if value is None else f"{value:,.{digits}f}{' ' if unit else ''}{unit}".replace(",", " ")


def _pair(values, digits, unit):
    return f"{number(values['rms'], digits, unit)} rms, {number(values['max'], digits, unit)} max"


def summary_table(summary, judged=()):
    """rich Table of the object that `metrics.summarise` returns, and of the requirements.Judged of a run."""
    every = ((section, *line) for section, lines in rows(summary, judged) for line in lines)
    return columns.sections(f"{summary['scenario']}, seed {summary['seed']}", every)


def rows(summary, judged=()):
    """(section, lines of name and value) of the summary, as texts."""
    yield "flight", _flight_rows(summary["flight"], stood=bool(summary["simulated_s"]))
    if summary["attitude_control"]:
        yield "attitude control", _control_rows(summary["attitude_control"])
    own = summary["software"]
    yield "star tracker", [*_own_rows(own, "star_tracker"), *_star_rows(summary["star_tracker"])]
    of = "computer" if "computer" in own else "navigation"
    yield "navigation", [*_own_rows(own, of), *_navigation_rows(summary["navigation"])]
    if judged:
        is_part = summary["ended_early"] or summary["until_s"] is not None
        yield "requirements", _requirement_rows(judged, is_part)
    if summary["warnings"]:
        yield (
            "warnings",
            ((one["field"], Text(one["text"], style="bold yellow")) for one in summary["warnings"]),
        )
    if "alignment" in summary:
        yield "alignment", start_rows.alignment(summary["alignment"])
        yield "clocks", start_rows.clocks(summary["clocks"])
    if summary.get("barometer"):
        yield "barometer", start_rows.barometer(summary["barometer"])
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
        yield (
            "height at the end",
            f"{number(flight['climbs_at_km'], 1, 'km')} above the ellipsoid, no apogee before it",
        )
    for name, key, digits, unit in _FLOWN:
        if flight[key] is not None:
            above = " above the ellipsoid" if key == "apogee_km" else ""
            yield name, f"{number(flight[key], digits, unit)}{above}"
    if flight.get("at_impact"):
        yield "impact at", place(flight["at_impact"])
    if stood and flight["max_speed_m_s"] is None:
        yield "motion", "none beyond the errors" if estimated else "none, it stands on the ground"
    if stood and estimated:
        yield "as estimated", "there is no truth"
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


def _star_rows(star):
    if not star["frames"]:
        yield "frames", "none taken"
        return
    share = f" ({100.0 * star['solved'] / star['in_window']:.1f} %)" if star["in_window"] else ""
    yield "frames", f"{star['frames']}, of which {star['in_window']} in the window"
    yield "solved in the window", f"{star['solved']}{share}"
    if outside := star.get("outside"):
        beyond = star["fixes"] - star["solved"]
        yield "outside it", f"{beyond} of {sum(outside.values())} solved; {_outside(outside)}"
    yield "wrong", Text(str(star["wrong"]), style="bold red" if star["wrong"] else "")
    yield from _rate_rows(star["by_rate"])
    if star["no_fix"]:
        reasons = (f"{reason.replace('_', ' ')} {count}" for reason, count in star["no_fix"].items())
        yield "no fix", ", ".join(reasons)
        if star["no_fix"].get("residuals", 0) > MANY * star["frames"]:
            words = "stars lie farther from their places than their centroids are said to be wrong by; "
            yield "residuals", Text(f"{words}star_tracker.centroid_floor allows for it", style="bold yellow")
    error = star["error_arcsec"]
    yield "error across the boresight", number(error["cross_axis_rms"], 1, '" rms')
    yield "error about the boresight", number(error["boresight_rms"], 1, '" rms')
    chain = star["chain_ms"]
    if chain["median"] is not None:
        median, p99 = (number(chain[key], 2, "ms") for key in ("median", "p99"))
        yield "time per frame", f"{median} median, 99 % below {p99}"


def _outside(counts):
    """Why frames are out of the window, in words."""
    words = {"sun": "too near to the Sun", "earth_limb": "to the Earth's limb"}
    words |= {"excluded": "too near to Sun or limb", "rate": "too fast"}  # a log that does not say to which
    if "sun" not in counts:
        words["earth_limb"] = "too near to the Earth's limb"
    return ", ".join(f"{counts[name]} {words[name]}" for name in words if name in counts)


def _rate_rows(by_rate):
    """Success against rate, of a star tracker that fixes well beyond the window's 2 deg/s."""
    if not any(row["solved"] for row in by_rate if row["from_deg_s"] >= FAST_DEG_S):
        return
    for row in by_rate:
        low, high = row["from_deg_s"], row["to_deg_s"]
        name = f"solved above {low:.0f} deg/s" if high is None else f"solved at {low:.0f} to {high:.0f} deg/s"
        share = 100.0 * row["solved"] / row["frames"]
        yield name, f"{row['solved']} of {row['frames']} ({share:.1f} %)"


def _own_rows(software, section):
    """Software of a user's own that flew in a section."""
    if section in software:
        yield "software", software[section]


def _navigation_rows(navigation):
    for name, key, digits, unit in _ERRORS:
        if navigation[key]["rms"] is not None:  # without truth there are none
            yield name, _pair(navigation[key], digits, unit)
    if pointing := navigation.get("while_pointing"):
        sizes = (("position_m", 1, "m"), ("velocity_m_s", 3, "m/s"), ("attitude_deg", 3, "deg about an axis"))
        largest = (number(pointing[key]["max"], digits, unit) for key, digits, unit in sizes)
        when = f"T{pointing['from_s']:+.0f} to {pointing['to_s']:+.0f} s"
        yield "while pointing", f"at most {', '.join(largest)}; {when}"
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
    for name, counts in navigation.get("instruments", {}).items():
        words = f"{counts['used']} of {counts['readings']} readings used"
        doubtful = 2 * counts["used"] < counts["readings"]
        yield name.replace("_", " "), Text(words, style="bold yellow" if doubtful else "")
    yield from _integrity_rows(navigation["integrity"])
    if navigation.get("position_rms_ned_m"):
        yield from _level_rows(navigation)
    for sensor, nis in navigation.get("nis", {}).items():
        if nis:
            low, high = nis["interval"]
            name = f"NIS, {sensor.replace('_', ' ')}"
            words = f"{low:.2f} to {high:.2f} expected if the sigmas are right"
            if sensor in TABLE and TABLE[sensor].errors_last:
                words = f"below {nis['dof']} where its sigmas are right, for its errors last"
            yield name, f"{nis['mean']:.2f}, mean of {nis['samples']}; {words}"
    nees = navigation["nees"]
    if nees["mean"] is not None:
        yield "NEES", _nees_words(nees)


def _nees_words(nees):
    """Errors over what the filter believes of them."""
    what = f"{nees['mean']:.1f} for {nees['dof']} degrees of freedom, {nees['samples']} epochs"
    if nees["mean"] > TOO_SURE * nees["dof"]:
        return Text(f"{what}: errors are larger than the filter's sigmas say", style="bold yellow")
    return what


def _integrity_rows(integrity):
    """When the solution may be used, and what was noticed; losses of GPS alone are too common to list."""
    if integrity is None:
        return
    for quantity in QUANTITIES:
        one = integrity[quantity]
        share, over = one["usable_share"], one["over_level"]
        largest = "" if over is None else f", error at most {over:.2f} of its protection level"
        yield f"{quantity} usable", f"{100.0 * share:.1f} % of the time{largest}{_doubts(quantity, one)}"
        if one["misleading_share"]:
            share = 100.0 * one["misleading_share"]
            yield f"{quantity} misleading", Text(f"{share:.2f} % of the time", style="bold red")
        if one["at_entry"]:
            yield f"{quantity} at entry", _entry_words(quantity, one["at_entry"])
    faults = _joined(integrity["noticed"])
    for entry in faults[:MOST_FAULTS]:
        until = "the end" if entry["until_s"] is None else f"T{entry['until_s']:+.1f} s"
        yield entry["source"].replace("_", " "), f"T{entry['from_s']:+.1f} s to {until}: {entry['reason']}"
    if len(faults) > MOST_FAULTS:
        yield "and", f"{len(faults) - MOST_FAULTS} more, see --json"


def _joined(noticed):
    """What was noticed, without losses of GPS; what goes on after such a loss is one entry."""
    out, last = [], {}
    for entry in noticed:
        if entry["reason"].startswith(("no fix", "no ranges")):
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
        and one["reason"].startswith(("no fix", "no ranges"))
        and before["until_s"] - 1e-6 <= one["from_s"] < entry["from_s"]
    ]
    covered_s = sum(one["until_s"] - one["from_s"] for one in gap)
    return bool(gap) and covered_s > 0.5 * (entry["from_s"] - before["until_s"])


LEVELS = {  # quantity: key of its levels, how they are shown
    "position": ("protection_m", "{:.1f} m horizontal, {:.1f} m vertical"),
    "velocity": ("protection_m_s", "{:.2f} m/s horizontal, {:.2f} m/s vertical"),
    "attitude": ("protection_deg", "{:.3f}, {:.3f}, {:.3f} deg"),
}


def _entry_words(quantity, entry):
    """Whether a quantity may be used at entry, and its protection level."""
    key, form = LEVELS[quantity]
    words = "usable" if entry["usable"] else f"do not use: {_doubt(quantity, entry['doubt'])}"
    known = None not in entry[key]
    return f"{words}, protection level {form.format(*entry[key]) if known else 'unknown'}"


def _doubt(quantity, name):
    """A Doubt about a quantity, for people."""
    return DOUBTS.get(name, name).format(quantity=quantity)


def _doubts(quantity, one):
    """Why a quantity was not usable: the two reasons that held longest."""
    longest = sorted(one["doubts"].items(), key=lambda one: -one[1])[:2]
    reasons = [f"{100.0 * share:.1f} %, {_doubt(quantity, name)}" for name, share in longest if share >= 5e-4]
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
    yield "late answers", Text(share, style="bold red" if late else "")


def _run_rows(summary):
    since = summary["simulated_from_s"]
    span = "" if since is None else f", from T{since:+.1f} s to T{since + summary['simulated_s']:+.1f} s"
    yield "simulated", number(summary["simulated_s"], 1, "s") + span
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
