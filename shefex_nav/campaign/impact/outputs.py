"""Where it lands, as numbers, as a table, and for maps: KML and GeoJSON."""

import json
import math
from typing import NamedTuple

import numpy as np

from shefex_nav.campaign import normality
from shefex_nav.campaign.impact import ellipses as ellipsing
from shefex_nav.campaign.impact import scatter
from shefex_nav.campaign.impact.landing import place
from shefex_nav.geometry import wgs84
from shefex_nav.report import columns, geography, track
from shefex_nav.report.table import number

NO_STATISTICS = "flown once; --runs draws the dispersions of the scenario"


class Result(NamedTuple):
    """Everything that is known of where a rocket lands, in one wind or several."""

    name: str  # of the mission
    seed: int
    ground: float  # m above the ellipsoid
    site: tuple  # rad, geodetic latitude and longitude of the launcher
    cases: tuple  # of scatter.Case
    landed: tuple  # of landing.Landed of each case
    aimed: tuple  # of aim.Aimed of each case; empty: nothing was aimed at
    points: object  # instantaneous.Points of the first case
    scattered: object  # scatter.Scattered; None: one flight
    ellipses: tuple  # of ellipses.Ellipse
    runs: int
    warnings: tuple = ()  # words about winds of another place


def summary(result):
    """Plain values, for JSON: degrees, metres, seconds."""
    first = result.cases[0].scenario
    found = {
        "scenario": result.name, "seed": result.seed, "ground_m": result.ground,
        "launcher": place(*result.site),
        "cases": [_case(result, k) for k in range(len(result.cases))],
        "not_followed": list(result.landed[0].unknown),
        "warnings": list(result.warnings),
        "runs": result.runs,
        "failed": [],
        "ellipses": [_ellipse(one) for one in result.ellipses],
        "without_ellipse": _without(result),
        "instantaneous_impact_points": _points(result.points),
    }  # fmt: skip
    if result.scattered is not None:
        found["failed"] = [{"run": run, "reason": reason} for run, reason in result.scattered.failed]
        found["dispersed"] = sorted(first.dispersions)
    return found


def _without(result):
    """Bodies that landed, but too few times for an ellipse."""
    drawn = {one.body for one in result.ellipses}
    held = {} if result.scattered is None else result.scattered.landings
    return [
        {"body": body, "landings": len(places), "reason": ellipsing.missing(len(places))}
        for body, places in held.items()
        if body not in drawn
    ]


def _case(result, k):
    case, landed = result.cases[k], result.landed[k]
    found = {
        "wind": case.wind,
        "azimuth_deg": math.degrees(case.scenario.launch.azimuth) % 360.0,
        "elevation_deg": math.degrees(case.scenario.launch.elevation),
        "landings": [
            {
                "body": one.body, "t_s": one.t_s, **place(one.latitude, one.longitude),
                "range_m": track.ground_distance(*result.site, one.latitude, one.longitude),
                "bearing_deg": math.degrees(_bearing(result.site, one)),
                "speed_m_s": one.speed, "below_horizon_deg": math.degrees(one.angle),
            }
            for one in landed.landings
        ],
    }  # fmt: skip
    if result.aimed:
        found |= {"miss_m": result.aimed[k].miss, "flights": result.aimed[k].flights}
    return found


def _bearing(site, one):
    """Direction of a landing from the launcher, rad, 0 to 2 pi: that of the chord, level at the launcher."""
    chord = wgs84.ecef_from_geodetic(one.latitude, one.longitude, 0.0) - wgs84.ecef_from_geodetic(*site, 0.0)
    north, east, _ = wgs84.dcm_en(*site).T @ chord
    return math.atan2(east, north) % (2.0 * math.pi)


def _ellipse(one):
    return {
        "body": one.body, "landings": len(one.offsets), "centre": place(one.latitude, one.longitude),
        "standard_error_m": {"north": one.error[0], "east": one.error[1]},
        "semi_axes_1_sigma_m": list(one.axes), "semi_axes_relative_error": one.axes_error,
        "azimuth_of_longer_deg": math.degrees(one.azimuth),
        "normality": _normality(one),
        "levels": [
            {"sigma": k, "contains_of_normal": one.holds(k), "landings_inside": n}
            for k, n in zip(ellipsing.SIGMAS, one.inside, strict=True)
        ],
    }  # fmt: skip


def _normality(one):
    """None: not tested."""
    return None if one.shape is None else {**one.shape._asdict(), "normal": one.shape.normal}


def _points(points):
    """Columns; None where there is no point."""
    columns = {"t_s": points.t_s.tolist()}
    for name, places in (("vacuum", points.vacuum), ("drag", points.drag)):
        for axis, values in zip(("latitude", "longitude"), np.degrees(places).T, strict=True):
            columns[f"{name}_{axis}_deg"] = [v if math.isfinite(v) else None for v in values.tolist()]
    return columns


def rows(found):
    """(section, name, value) of a `summary`, as texts."""
    for case in found["cases"]:
        section = f"wind: {case['wind']}"
        setting = f"azimuth {case['azimuth_deg']:.2f} deg, elevation {case['elevation_deg']:.2f} deg"
        yield section, "launcher", setting
        if "miss_m" in case:
            yield section, "aimed", f"{case['miss_m']:.0f} m off, after {case['flights']} flights"
        for one in case["landings"]:
            far = number(one["range_m"] / 1e3, 2, "km")
            place = f"{_degrees(one)}, T{one['t_s']:+.0f} s, {far} from the launcher"
            way = f"{place} at {one['bearing_deg']:.1f} deg, {one['speed_m_s']:.0f} m/s, "
            yield section, one["body"], way + f"{one['below_horizon_deg']:.0f} deg below the horizon"
    for name in found["not_followed"]:
        yield (
            "not followed",
            name,
            f"the drag of the empty stage is not described: vehicle.stages.{name}.spent",
        )
    if not found["runs"]:
        yield "dispersion", "", NO_STATISTICS
    for one in found["ellipses"]:
        section = f"{one['body']}: {one['landings']} landings"
        north, east = one["standard_error_m"].values()
        error = f"standard error {north:.0f} m north, {east:.0f} m east"
        yield section, "centre", f"{_degrees(one['centre'])}, {error}"
        yield section, "semi-axes", f"standard error {100 * one['semi_axes_relative_error']:.0f} %"
        for level in one["levels"]:
            k = level["sigma"]
            axes = " by ".join(number(k * axis / 1e3, 3, "km") for axis in one["semi_axes_1_sigma_m"])
            share = f"holds {100 * level['contains_of_normal']:.1f} % of a normal distribution"
            text = f"semi-axes {axes}, the longer at {one['azimuth_of_longer_deg']:.0f} deg; {share}; "
            yield section, f"{k} sigma", text + f"{level['landings_inside']} of {one['landings']} inside"
        yield section, *_normal(one)
    for one in found["without_ellipse"]:
        count = f"{one['landings']} landing{'s' * (one['landings'] > 1)}"
        yield "dispersion", one["body"], f"{count}; {one['reason']}"
    for one in found["failed"]:
        yield "did not land", f"run {one['run']}", one["reason"]


def _normal(one):
    """(name, value) of whether an entry of "ellipses" has normal landings, and what follows if not."""
    found = one["normality"]
    if found is None:
        return "normal", f"not tested: fewer than {normality.FEWEST} landings, or all on a line"
    text = (
        f"skewness {found['skewness']:.2f} (p {found['p_skewness']:.1g}; normal 0), "
        f"kurtosis {found['kurtosis']:.2f} (p {found['p_kurtosis']:.1g}; normal 8)"
    )
    if found["normal"]:
        return "normal", f"nothing against it: {text}"
    inside = ", ".join(str(level["landings_inside"]) for level in one["levels"])
    follows = (
        f"the ellipses hold {inside} of {one['landings']}; use these counts, not the shares of a normal one"
    )
    return "not normal", f"{text}: {follows}"


def _degrees(place):
    latitude, longitude = place["latitude_deg"], place["longitude_deg"]
    return f"{abs(latitude):.4f} {'NS'[latitude < 0]}, {abs(longitude):.4f} {'EW'[longitude < 0]}"


def table(found):
    """rich Table of a summary."""
    title = f"{found['scenario']}, seed {found['seed']}: where it lands, ground {found['ground_m']:g} m"
    return columns.sections(title, rows(found), widest=34)


# ---- maps ------------------------------------------------------------------------------------------------


def lines_and_places(result):
    """(list of geography.Line, list of geography.Place) of paths, impact points, ellipses and landings."""
    lines = [
        geography.Line(f"path of {way.body}", _of_path(way))
        for landed in result.landed[:1]
        for way in landed.paths
    ]
    for name, places in (("vacuum", result.points.vacuum), ("drag", result.points.drag)):
        held = places[np.isfinite(places).all(axis=1)]
        if len(held):
            lines.append(geography.Line(f"impact points, {name}", _of_places(held, result.ground)))
    for one in result.ellipses:
        lines += [
            geography.Line(
                f"{one.body}, {k} sigma, {_held(one, k)}",
                _of_places(one.outline(k), result.ground),
            )
            for k in ellipsing.SIGMAS
        ]
    places = [geography.Place("launcher", 0.0, "", _of_places(np.array([result.site]), result.ground)[0])]
    for case, landed in zip(result.cases, result.landed, strict=True):
        for one in landed.landings:
            at = _of_places(np.array([[one.latitude, one.longitude]]), result.ground)[0]
            places.append(geography.Place(one.body, one.t_s, f"impact; wind: {case.wind}", at))
    return lines, places


def _held(one, k):
    """What the ellipse of k sigma holds: of a normal distribution, or counted where the landings are not."""
    if one.not_normal:
        return f"not normal: {one.inside[ellipsing.SIGMAS.index(k)]} of {len(one.offsets)} landings"
    return f"{100 * one.holds(k):.1f} %"


def _of_places(places, height):
    return [(round(float(b), 8), round(float(a), 8), height) for a, b in np.degrees(places)]


def _of_path(way):
    found = [wgs84.geodetic_from_ecef(r) for r in way.r_e]
    return [(round(math.degrees(b), 8), round(math.degrees(a), 8), round(float(h), 3)) for a, b, h in found]


def geojson(result):
    """A FeatureCollection: str."""
    lines, places = lines_and_places(result)
    return geography.collection(lines, places, {"scenario": result.name, "seed": result.seed})


def kml(result):
    """A KML document: str."""
    lines, places = lines_and_places(result)
    return geography.document(f"{result.name}, seed {result.seed}: where it lands", lines, places)


def samples(result):
    """All landings of the runs as JSON text: {landings: {body: [{run, ...}]}, failed: [{run, ...}]}."""
    held = result.scattered
    landings = {
        body: [
            {"run": run, "wind": scatter.case_of(result.cases, run).wind, **place(*map(float, one))}
            for run, one in zip(held.flown, places, strict=True)
        ]
        for body, places in held.landings.items()
    }
    failed = [
        {"run": run, "wind": scatter.case_of(result.cases, run).wind, "reason": reason}
        for run, reason in held.failed
    ]
    return json.dumps({"landings": landings, "failed": failed}, indent=1) + "\n"
