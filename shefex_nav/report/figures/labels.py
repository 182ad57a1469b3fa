"""Names beside points of a drawing, placed so that they cover neither each other nor the points."""

import numpy as np

_FONT = 9.0  # points
_LETTER = 0.6  # width of a letter over the size of the font, DejaVu Sans, generous
_AROUND = np.radians([90, 60, 120, 30, 150, 0, 180, -30, -150, -60, -120, -90])  # tried in this order
_AWAY = (14.0, 24.0, 38.0, 54.0, 72.0, 96.0, 130.0)  # points from the place to the name, likewise


def place(axes, xy, names, *, avoid=None, colour="black"):
    """Annotate points of the data of an axes; what finds no room has a dot, but no name.

    Call it when the limits are settled. xy : (n, 2), the most important first;  names : n texts;
    avoid : (m, 2) further points that names keep off;  colour : of the names. Returns their number.
    """
    if not len(names):
        return 0
    axes.apply_aspect()
    scale = 72.0 / axes.figure.dpi
    points = axes.transData.transform(np.asarray(xy, dtype=float)) * scale
    others = points if avoid is None else np.vstack([points, axes.transData.transform(avoid) * scale])
    edge = axes.get_window_extent().extents * scale
    inside = np.array([edge[0], edge[1], edge[2], edge[3] + 4.0])
    taken, done = [], 0
    for point, name in zip(points, names, strict=True):
        found = _room(point, name, others, taken, inside)
        if found is None:
            continue
        box, offset = found
        taken.append(box)
        others = np.vstack([others, _line(point, offset, box)])
        done += 1
        axes.annotate(
            name, axes.transData.inverted().transform(point / scale), offset, textcoords="offset points",
            ha="center", va="center", fontsize=_FONT, annotation_clip=False, color=colour,
            arrowprops={"arrowstyle": "-", "color": "#767676", "lw": 0.6, "shrinkA": 0, "shrinkB": 3},
        )  # fmt: skip
    return done


def together(axes, xy, near):
    """Points of the data of an axes whose marks cover each other: list of lists of their numbers, in order.

    Call it when the limits are settled. xy : (n, 2);  near : points of print from the first of a group
    """
    axes.apply_aspect()
    points = axes.transData.transform(np.asarray(xy, dtype=float)) * 72.0 / axes.figure.dpi
    groups = []
    for k, point in enumerate(points):
        if groups and np.hypot(*(point - points[groups[-1][0]])) < near:
            groups[-1].append(k)
        else:
            groups.append([k])
    return groups


def _room(point, name, others, taken, inside):
    """(box of four numbers, offset of its middle) of the nearest free place, or None. All in points."""
    half = np.array([0.5 * _LETTER * _FONT * len(name) + 2.0, 0.65 * _FONT + 1.0])
    for away in _AWAY:
        for angle in _AROUND:
            direction = np.array([np.cos(angle), np.sin(angle)])
            offset = direction * (away + half * np.abs(direction))
            box = np.concatenate([point + offset - half, point + offset + half])
            if box[0] < inside[0] or box[1] < inside[1] or box[2] > inside[2] or box[3] > inside[3]:
                continue
            line = _line(point, offset, box)
            if any(_overlap(box, other) or _within(line, other) for other in taken):
                continue
            if not _within(others, box, 1.5):
                return box, offset
    return None


def _line(point, offset, box):
    """Points along the line from the place to its name."""
    line = point + np.linspace(0.15, 1.0, 12)[:, None] * offset
    return line[~((line > box[:2]) & (line < box[2:])).all(axis=1)]


def _within(points, box, margin=0.0):
    """Whether any of the points lies in a box."""
    return bool(((points > box[:2] - margin) & (points < box[2:] + margin)).all(axis=1).any())


def _overlap(a, b):
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
