"""The words and tables of the report of one run."""

import platform

import numpy as np

from shefex_nav import __version__, event_words
from shefex_nav.records import QUANTITIES
from shefex_nav.report import html, local_level, requirements, sensor_use, table, trust
from shefex_nav.report.html import element
from shefex_nav.report.sizes import percent
from shefex_nav.report.table_rows import rates

_MOST_INCIDENTS = 40
_DASH = "–"


def lead(run):
    """What flew, when, and where the log ends if that is not the end of the mission."""
    mission, summary = run.data.mission, run.summary
    words = [run.limits.description.rstrip(".")] if run.limits.description else []
    words.append(f"epoch (T+0 s) {mission.epoch_utc.replace('T', ' ').removesuffix('Z')} UTC")
    if summary["simulated_s"] is not None:
        what = f"{summary['simulated_s']:.1f} s {local_level.done(summary)}"
        words.append(f"{what} from T{summary['simulated_from_s']:+.1f} s")
    parts = [element("p", "; ".join(words) + ".", class_="lead")]
    if summary["failure"]:
        cut = (
            f"The flight failed: {summary['failure'].splitlines()[0]}. Everything on this page is up to then."
        )
        parts.append(_strong(cut, "verdict bad"))
    elif summary["ended_early"]:
        end = (
            f"T{run.data.last_t_s:+.2f} s"
            if np.isfinite(run.data.last_t_s)
            else "before its first sample of truth"
        )
        cut = f"The run was cut off: its log ends at {end}. Everything on this page is up to then."
        parts.append(_strong(cut, "verdict bad"))
    elif summary["until_s"] is not None:
        cut = f"The mission was looked at until T{summary['until_s']:+.2f} s. "
        cut += "Everything on this page is up to then."
        parts.append(_strong(cut, "verdict open"))
    if run.limits.problem:
        told = "The scenario in the log cannot be read by this version, so its limits are not shown: "
        told += run.limits.problem
        parts.append(element("p", told, class_="verdict open"))
    return html.join(parts)


def _strong(words, kind):
    """A paragraph that is seen. kind : of page.css"""
    return element("p", element("strong", words), class_=kind)


def summary(run, found):
    """Verdict, figures, requirements, what went wrong."""
    judged, source = judge(run)
    is_part = run.summary["ended_early"] or run.summary["until_s"] is not None
    unfit, told = run.summary["warnings"], run.summary.get("told_otherwise")
    parts = [_verdict(judged, is_part)]
    if unfit:
        parts.append(_fields("The scenario does not fit the flight:", unfit, "verdict bad"))
    if told:
        words = "The computer on board is told figures that are not those of the sensors:"
        parts.append(_fields(words, told, "verdict open"))
    parts.append(_tiles(run))
    if judged:
        rows = [
            (
                one.name.replace("_", " "),
                requirements.words(one.name, one.required, one.unit),
                requirements.in_words(one),
                _kept(one, is_part),
            )
            for one in judged
        ]
        parts.append(html.table(f"Requirements {source}", ("requirement", "required", "this run", ""), rows))
        parts += [
            element("p", f"{quantity.capitalize()}, met and not usable: {words}.")
            for quantity, words in trust.vouched(run.summary, judged)
        ]
    parts.append(element("h3", "What went wrong, and when"))
    parts += [_incidents(found, bool(run.summary["navigation"].get("unknown"))), *_of_sensors(run)]
    return parts


def _fields(words, found, kind):
    """Words, and a list of fields of the scenario with what is said of each. kind : of page.css"""
    items = [
        element("li", element("code", html.breakable(one["field"])), f": {one['text']}") for one in found
    ]
    return element("div", element("strong", words), element("ul", *items), class_=kind)


def judge(run):
    """(list of requirements.Judged, where they are stated) of a run."""
    stated = run.limits.requirements
    if stated is not None and requirements.limits(stated):
        return requirements.judge(stated, run.summary), "of the scenario"
    if "attitude" in run.limits.limits and run.summary["navigation"]["at_entry"]:
        limit = float(f"{np.degrees(run.limits.limits['attitude']):.12g}")
        figures = requirements.figures_of(run.summary)
        return requirements.judge_figures({"attitude_at_entry": limit}, figures), "of requirements.attitude"
    return [], ""


def _kept(one, is_part):
    words = requirements.verdict(one, is_part)
    if words in (requirements.UNREACHED, requirements.UNJUDGED):
        return element("span", words)
    return element("span", words, class_="met" if one.passed else "missed")


def _verdict(judged, is_part):
    if not judged:
        return element("p", "The scenario states no requirements.", class_="verdict open")
    verdicts = {one.name.replace("_", " "): requirements.verdict(one, is_part) for one in judged}
    unseen = [name for name, words in verdicts.items() if words == requirements.UNREACHED]
    missed = [name for name, words in verdicts.items() if words.startswith("not met")]
    so_far = " so far" if any(words.endswith("so far") for words in verdicts.values()) else ""
    if missed and not all(verdicts[name].endswith("so far") for name in missed):
        so_far = ""  # what is missed for good is not missed so far
    if unseen and not missed:
        words = f"{len(unseen)} of {len(judged)} requirements not reached: {', '.join(unseen)}."
        return _strong(words, "verdict open")
    unjudged = [name for name, words in verdicts.items() if words == requirements.UNJUDGED]
    if unjudged and not missed:
        words = f"{len(unjudged)} of {len(judged)} requirements cannot be judged, {requirements.NO_LEVELS}: "
        others = f" The others are met{so_far}." if len(judged) > len(unjudged) else ""
        words = f"{words}{', '.join(unjudged)}.{others}"
        return _strong(words, "verdict open")
    if not missed:
        which = "The requirement is met" if len(judged) == 1 else f"All {len(judged)} requirements are met"
        return _strong(f"{which}{so_far}.", "verdict open" if so_far else "verdict")
    words = f"{len(missed)} of {len(judged)} requirements not met{so_far}: {', '.join(missed)}."
    return _strong(words, "verdict bad")


def _tiles(run):
    """The figures that say most, those that the run has."""
    flight, star, nav = (run.summary[key] for key in ("flight", "star_tracker", "navigation"))
    entry, nees = nav["at_entry"], nav["nees"]
    tiles = [
        ("apogee", _number(flight["apogee_km"], 1, "km"), ""),
        ("range", _number(flight["range_km"], 1, "km"), ""),
        ("impact", table.place(flight["at_impact"], 2) if flight["at_impact"] else _DASH, ""),
        ("highest speed", _number(flight["max_speed_m_s"], 0, "m/s"), ""),
        ("star fixes in the window", *_star_tile(star)),
        ("attitude error", *_rms_tile(nav["attitude_error_deg"], 3, "deg")),
        *_pointing_tile(nav["while_pointing"]),
        ("velocity error", *_rms_tile(nav["velocity_error_m_s"], 3, "m/s")),
        ("position error", *_rms_tile(nav["position_error_m"], 1, "m")),
        ("NEES of 9", _number(nees["mean"], 1, ""), _of_nees(nees, flight["at_entry"])),
    ]
    if entry:
        largest = max(abs(value) for value in entry["attitude_error_deg"])
        when = f"at {entry['altitude_km']:.0f} km, T{entry['t_s']:+.1f} s"
        tiles[4:4] = [
            ("attitude error at entry", _number(largest, 4, "deg"), f"largest axis, {when}"),
            ("position error at entry", _number(entry["position_error_m"], 2, "m"), when),
        ]
    if nav["integrity"]:
        tiles += [_usable_tile(quantity, nav["integrity"][quantity]) for quantity in QUANTITIES]
    shown = [
        element("div", element("dt", name), element("dd", value, *([element("small", note)] if note else [])))
        for name, value, note in tiles
        if value != _DASH
    ]
    return element("dl", *shown, class_="tiles") if shown else ""


def _of_nees(nees, entry):
    """Which epochs a NEES is of. entry : of `flight`, None without one"""
    since = "start" if nees.get("why") else "first star fix"
    return f"{nees['samples']} epochs, from the {since} to {'entry' if entry else 'the end'}"


def _pointing_tile(pointing):
    """The largest attitude error while the vehicle points; none if it never does."""
    if pointing is not None:
        when = f"largest about an axis, T{pointing['from_s']:+.0f} to {pointing['to_s']:+.0f} s"
        yield "attitude error while pointing", _number(pointing["attitude_deg"]["max"], 4, "deg"), when


def _usable_tile(quantity, one):
    """Share of the time in which a quantity may be used, and how near its errors came to the level."""
    share, over = one["misleading_share"], one["over_level"]
    words = ""
    if one["usable_share"] and share is not None:
        never = "never misleading"
        if over is not None and over > 1.0:
            never = f"never misleading for more than {trust.TIME_TO_ALERT_S:g} s"
        words = never if share == 0.0 else f"misleading {percent(share, 2)}"
    if over is not None:
        words += f"{', ' if words else ''}error at most {over:.2f} of its level"
    return f"{quantity} usable", percent(one["usable_share"]), words


def _number(value, digits, unit):
    return _DASH if value is None else table.number(value, digits, unit)


def _star_tile(star):
    if not star["in_window"]:
        return _DASH, ""
    share = star["solved"] / star["in_window"]
    return percent(share), f"{star['solved']} of {star['in_window']} frames, {star['wrong']} wrong"


def _rms_tile(values, digits, unit):
    if values["rms"] is None:
        return _DASH, ""
    return f"{_number(values['rms'], digits, unit)} rms", f"{_number(values['max'], digits, unit)} at most"


def _of_sensors(run):
    """What became of the measurements of GPS and star tracker, and what is not known of software."""
    navigation = run.summary["navigation"]
    said = [f"{name}: {words}" for name, words, _ in sensor_use.rows(navigation.get("measurements") or {})]
    said += [f"Not known: {words}" for words in navigation.get("unknown") or ()]
    if said:
        yield element("ul", *(element("li", f"{one}.") for one in said))


def _incidents(found, open_):
    """Table of Incidents. open_ : whether the software does not say all that they are found by"""
    if not found:
        words = "Nothing: no sensor was lost or refused, and the solution could be used all the time."
        if open_:
            words = "Nothing of what the log can tell of this software; what it cannot tell follows."
        return element("p", words)
    rows = [
        (_short(f"T{one.from_s:+.2f} s"), _short(_until(one)), one.what) for one in found[:_MOST_INCIDENTS]
    ]
    parts = [html.table("", ("from", "to", "what"), rows)]
    if len(found) > _MOST_INCIDENTS:
        parts.append(
            element(
                "p", f"And {len(found) - _MOST_INCIDENTS} more, see the figures of consistency and trust."
            )
        )
    return html.join(parts)


def _short(words):
    """Words that stay on one line."""
    return element("span", words, class_="short")


def _until(one):
    if one.until_s is None:
        return "the end of the log"
    return "" if one.until_s == one.from_s else f"T{one.until_s:+.2f} s"


def tables(run, section):
    """Tables at the head of a section."""
    if section == "flight" and run.data.events:
        rows = [
            (
                event_words.in_words(event.name),
                f"{event.t_s:+.2f}",
                f"{event.altitude_m / 1e3:.2f}",
                event.detail,
            )
            for event in run.data.events
        ]
        yield html.table("Events", ("event", "T [s]", "height [km]", ""), rows, numbers=(1, 2))
    if section == "star tracker" and run.summary["star_tracker"]["by_rate"]:
        rows = [_rate_row(row) for row in run.summary["star_tracker"]["by_rate"]]
        heads = (
            *("true rate [deg/s]", "frames", "with a fix", "wrong"),
            *("across, per axis [arcsec rms]", "about [arcsec rms]"),
            *("across, scatter [arcsec]", "about, scatter [arcsec]", "NEES of 3"),
        )
        title = "Success by rate, outside the exclusion angles; scatter and NEES without the mean of the run"
        yield html.table(title, heads, rows, numbers=range(1, 9))
    if section == "navigation" and run.summary["navigation"]["at_entry"]:
        yield _entry_table(run.summary["navigation"]["at_entry"])


def _rate_row(row):
    keys = "cross_axis_rms", "boresight_rms", "cross_axis_scatter", "boresight_scatter"
    sizes = (_number(row[f"{key}_arcsec"], 1, "") for key in keys)
    return rates(row), row["frames"], row["solved"], row["wrong"], *sizes, _number(row["nees"], 1, "")


def _entry_table(entry):
    rows = [
        (
            "position [m]",
            _number(entry["position_error_m"], 3, ""),
            _number(entry["position_sigma_m"], 3, ""),
        ),
        (
            "velocity [m/s]",
            _number(entry["velocity_error_m_s"], 4, ""),
            _number(entry["velocity_sigma_m_s"], 4, ""),
        ),
    ]
    sigmas = entry["attitude_sigma_deg"] or [None] * 3
    for axis, error, sigma in zip("xyz", entry["attitude_error_deg"], sigmas, strict=True):
        rows.append((f"attitude about {axis} [deg]", f"{error:+.5f}", _number(sigma, 5, "")))
    title = f"At entry: {entry['altitude_km']:.1f} km, T{entry['t_s']:+.2f} s"
    return html.table(title, ("", "error", "1 sigma"), rows, numbers=(1, 2))


def origin(run):
    """Where all this comes from: versions, machine-made figures, the scenario."""
    import matplotlib

    mission = run.data.mission
    versions = {
        "shefex_nav": __version__,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "matplotlib": matplotlib.__version__,
    }
    rows = [
        ("log", run.log),
        ("sha256 of the log", run.digest or _DASH),
        (f"{local_level.done(run.summary)} by", f"shefex_nav {mission.version}"),
        ("scenario", mission.scenario),
        ("seed", str(mission.seed)),
        ("page made by", ", ".join(f"{name} {version}" for name, version in versions.items())),
    ]
    if run.summary["wall_s"] is not None:
        factor = run.summary["real_time_factor"]
        speed = f", {factor:.0f} times faster than the flight" if factor else ""
        rows.append(("simulation took", f"{run.summary['wall_s']:.1f} s{speed}"))
    parts = [html.table("", (), rows)]
    if mission.scenario_text:
        parts += [element("h3", "Scenario as flown"), element("pre", mission.scenario_text)]
    return parts
