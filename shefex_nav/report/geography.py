"""The ground track for maps: KML (OGC 07-147r2) and GeoJSON (RFC 7946).

Truth and estimate are lines in space, events points on them. Longitude and latitude are geodetic, WGS 84, in
that order. Heights are metres above the ellipsoid, as RFC 7946 has them; KML counts from the geoid, which is
up to 110 m away from it (some 30 m above it in northern Norway): what is drawn is off by that.
"""

import json
import math
import re
from itertools import pairwise
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np

from shefex_nav import event_words
from shefex_nav.records import Event
from shefex_nav.report import flight, local_level
from shefex_nav.report.figures import flown
from shefex_nav.report.pairing import at_rows, is_partly_true

MOST_POINTS = 3000  # of a line
_DIGITS = 8, 3  # of degrees (1 mm) and metres
_PLAIN = "ffb27200"
_COLOURS = {"truth": "ffb27200", "estimate": "ff005ed5"}  # aabbggrr


class Line(NamedTuple):
    """A path in space."""

    name: str
    points: list  # of (longitude deg, latitude deg, height m)


class Place(NamedTuple):
    """An event."""

    name: str
    t_s: float
    detail: str
    point: tuple


def lines_and_places(data):
    """(list of Line, list of Place) of a RunData; places by truth, without one of all by the estimate."""
    paths = []
    if len(data.truth.t_s):
        paths.append(flown.of_states("truth", data, data.truth, MOST_POINTS))
    if len(data.nav.t_s):
        paths.append(flown.estimate(data, MOST_POINTS))
    lines = [Line(path.name, _points(path.track)) for path in paths]
    states = data.truth if len(data.truth.t_s) and not is_partly_true(data) else data.nav
    places, events = [], [*data.events, *_as_estimated(data)]
    for event in events if len(states.t_s) else ():
        k = int(np.argmin(np.abs(states.t_s - event.t_s)))
        row = at_rows(states, slice(k, k + 1))
        at = flown.of_states("", data, row, 1)
        places.append(Place(event_words.in_words(event.name), event.t_s, event.detail, _points(at.track)[0]))
    return lines, places


def _as_estimated(data):
    """Event of what a run without truth does not record, but its solution shows."""
    told = {event.name for event in data.events}
    return [Event(t_s, name, math.nan, "as estimated") for name, t_s in flight.seen(data) if name not in told]


def _points(track):
    rows = zip(np.degrees(track.longitude), np.degrees(track.latitude), track.height, strict=True)
    return [(round(float(a), _DIGITS[0]), round(float(b), _DIGITS[0]), round(float(h), _DIGITS[1]))
            for a, b, h in rows]  # fmt: skip


def geojson(data):
    """A FeatureCollection: str. A line that crosses the antimeridian is cut there (RFC 7946, 3.1.9)."""
    about = {"scenario": data.mission.scenario}
    about |= {} if local_level.is_replay(data) else {"seed": data.mission.seed}
    return collection(*lines_and_places(data), about)


def collection(lines, places, about):
    """A FeatureCollection of Lines and Places: str. about : properties of every line"""
    features = [
        {
            "type": "Feature",
            "properties": {"name": line.name, **about},
            "geometry": _line_geometry(line.points),
        }
        for line in lines
    ]
    features += [
        {
            "type": "Feature",
            "properties": {"name": place.name, "t_s": place.t_s, "detail": place.detail},
            "geometry": {"type": "Point", "coordinates": list(place.point)},
        }
        for place in places
    ]
    return json.dumps({"type": "FeatureCollection", "features": features}, allow_nan=False, indent=1) + "\n"


def _line_geometry(points):
    pieces = _cut(points)
    if len(pieces) == 1:
        return {"type": "LineString", "coordinates": [list(point) for point in pieces[0]]}
    return {"type": "MultiLineString", "coordinates": [[list(p) for p in piece] for piece in pieces]}


def _cut(points):
    """The pieces of a line between its crossings of the antimeridian, each with both ends on it."""
    pieces, piece = [], [points[0]]
    for before, after in pairwise(points):
        leap = after[0] - before[0]
        if abs(leap) > 180.0:
            side = -180.0 if leap > 0 else 180.0
            share = (side - before[0]) / (leap - np.copysign(360.0, leap))
            at = [round(float(b + share * (a - b)), 8) for b, a in zip(before[1:], after[1:], strict=True)]
            pieces.append([*piece, (side, *at)])
            piece = [(-side, *at)]
        piece.append(after)
    if len(piece) == 1:
        piece = piece * 2  # a line has two points at least
    return [*pieces, piece]


def kml(data):
    """A KML document: str."""
    return document(local_level.title(data), *lines_and_places(data), _COLOURS)


def document(title, lines, places, colours=None):
    """A KML document of Lines and Places: str. colours : {name of a line: aabbggrr}; None: one for all"""
    colours = colours or dict.fromkeys((line.name for line in lines), _PLAIN)
    styles = {name: re.sub(r"\W+", "-", name) for name in colours}  # an id has no spaces
    out = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        '<kml xmlns="http://www.opengis.net/kml/2.2">',
        f"<Document><name>{escape(title)}</name>",
        "<description>Heights are above the WGS 84 ellipsoid.</description>",
    ]
    for name, colour in colours.items():
        style = f"<LineStyle><color>{colour}</color><width>3</width></LineStyle>"
        out.append(f'<Style id="{styles[name]}">{style}</Style>')
    for line in lines:
        coordinates = " ".join(f"{a:.8f},{b:.8f},{h:.3f}" for a, b, h in line.points)
        out.append(
            f"<Placemark><name>{escape(line.name)}</name><styleUrl>#{styles[line.name]}</styleUrl><LineString>"
            f"<altitudeMode>absolute</altitudeMode><coordinates>{coordinates}</coordinates>"
            "</LineString></Placemark>"
        )
    for place in places:
        a, b, h = place.point
        words = escape(f"T{place.t_s:+.2f} s; {place.detail}".rstrip("; "))
        out.append(
            f"<Placemark><name>{escape(place.name)}</name><description>{words}</description><Point>"
            "<extrude>1</extrude><altitudeMode>absolute</altitudeMode>"
            f"<coordinates>{a:.8f},{b:.8f},{h:.3f}</coordinates></Point></Placemark>"
        )
    return "\n".join([*out, "</Document>", "</kml>", ""])
