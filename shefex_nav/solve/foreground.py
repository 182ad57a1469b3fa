"""Which objects of a picture are no stars: gaps between leaves, beads of a trail, blocks of a JPEG, clouds.

In: the picture without its background, and objects in it. Out: what speaks against each. None of it is
certain: `field` puts what is doubted behind the rest.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.solve.background import nth

RING_PX = (2.0, 5.5)  # around an object and its radius; a star has the sky there
ABOVE_SIGMA = 5.0  # of the noise, the peak of a star over the brightest tile near an edge
AROUND_PX, EVERY_PX, OWN_PX = 42, 6, 3.0  # of a prominence: how far, in what steps, and not near the object
LEAST_AROUND = 20  # places, to tell the scatter
QUANTILE, OF_SIGMA = 0.9, 1.645  # of the scatter: of a normal distribution 1.645 sigma
MANY, COMPARABLE = 4, 0.5  # objects around one; of its height
MOST_IN_LINE, LINE_PX, LINE_OF = 80, 2.0, 8  # brightest objects; so many within this of a line are a trail


@kernel
def crowding(flat, xy_px, radius_px, limit):
    """Share of the pixels around each object that differ from the background by its limit. -> (n,).

    limit : (n,) grey values
    """
    share = np.zeros(xy_px.shape[0])
    rows, columns = flat.shape
    for k in range(xy_px.shape[0]):
        x, y = xy_px[k, 0], xy_px[k, 1]
        near, far = radius_px[k] + RING_PX[0], radius_px[k] + RING_PX[1]
        other, total = 0, 0
        for r in range(max(int(y - far), 0), min(int(y + far) + 2, rows)):
            for c in range(max(int(x - far), 0), min(int(x + far) + 2, columns)):
                d2 = (c - x) ** 2 + (r - y) ** 2
                if near * near <= d2 <= far * far:
                    total += 1
                    other += abs(flat[r, c]) > limit[k]
        share[k] = other / max(total, 1)
    return share


def brighter_than_sky(grey, xy_px, sky, noise):
    """Whether the brightest pixel around each centroid is above the sky of its tile. -> (n,) bool."""
    if len(xy_px) == 0:
        return np.zeros(0, dtype=bool)
    column, row = np.rint(xy_px).astype(int).T
    near = [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]  # detections are not at the border
    peak = np.max([grey[r, c] for r, c in near], axis=0)
    tile = row * sky.shape[0] // grey.shape[0], column * sky.shape[1] // grey.shape[1]
    return peak > sky[tile] + ABOVE_SIGMA * noise


@kernel
def prominence(flat, xy_px, radius_px, floor):
    """Height of each object above what is around it, over the scatter of that. -> (n,), 0 where little is.

    Both of means of nine pixels, the latter on a grid: a block of a JPEG, a cloud's ridge or a gap between
    leaves is no higher than others beside it, whatever the noise of single pixels. The scatter is by the
    quantile of 90 %, which stars do not reach; it is not below the floor.
    """
    rows, columns = flat.shape
    found = np.zeros(xy_px.shape[0])
    means = np.empty((2 * AROUND_PX // EVERY_PX + 1) ** 2)
    for k in range(xy_px.shape[0]):
        column, row, m = int(xy_px[k, 0] + 0.5), int(xy_px[k, 1] + 0.5), 0
        if row < 1 or column < 1 or row > rows - 2 or column > columns - 2:
            continue
        own2 = (radius_px[k] + OWN_PX) ** 2
        for i in range(-AROUND_PX, AROUND_PX + 1, EVERY_PX):
            for j in range(-AROUND_PX, AROUND_PX + 1, EVERY_PX):
                r, c = row + i, column + j
                if i * i + j * j >= own2 and 1 <= r <= rows - 2 and 1 <= c <= columns - 2:
                    means[m] = _nine(flat, r, c)
                    m += 1
        if m < LEAST_AROUND:
            continue
        middle = nth(means, m // 2, m)
        for i in range(m):
            means[i] = abs(means[i] - middle)
        scatter = nth(means, int(QUANTILE * m), m) / OF_SIGMA
        found[k] = (_nine(flat, row, column) - middle) / max(scatter, floor)
    return found


@inner
def _nine(flat, row, column):
    """Mean of the nine pixels about one."""
    total = 0.0
    for r in range(row - 1, row + 2):
        for c in range(column - 1, column + 2):
            total += flat[r, c]
    return total / 9.0


@kernel
def among_others(xy_px, height, trusted, reach_px):
    """Which trusted objects stand among more that are not trusted and no fainter by much. -> (n,) bool.

    A gap in a tree has others around it, a star in the sky has none. What is faint does not count: blocks
    of a JPEG are everywhere.
    """
    n = xy_px.shape[0]
    among = np.zeros(n, dtype=np.bool_)
    for k in range(n):
        if not trusted[k]:
            continue
        own, others = 0, 0
        for m in range(n):
            near = (xy_px[m, 0] - xy_px[k, 0]) ** 2 + (xy_px[m, 1] - xy_px[k, 1]) ** 2 < reach_px**2
            if near and height[m] > COMPARABLE * height[k]:
                if trusted[m]:
                    own += 1
                else:
                    others += 1
        among[k] = others >= MANY and others > 2 * own
    return among


@kernel
def in_line(xy_px, n):
    """Which of n objects are beads of a trail, of an aircraft or a satellite; brightest first. -> (n,).

    Of the MOST_IN_LINE brightest, anywhere in a picture, 0.4 are within 2 px of the line through two: eight
    are none by chance.
    """
    beads, m = np.zeros(n, dtype=np.bool_), min(n, MOST_IN_LINE)
    for i in range(m):
        for j in range(i):
            dx, dy = xy_px[j, 0] - xy_px[i, 0], xy_px[j, 1] - xy_px[i, 1]
            reach = LINE_PX * np.sqrt(dx * dx + dy * dy)
            near = 0
            for k in range(m):
                near += abs(dx * (xy_px[k, 1] - xy_px[i, 1]) - dy * (xy_px[k, 0] - xy_px[i, 0])) < reach
            if near >= LINE_OF:
                for k in range(m):
                    if abs(dx * (xy_px[k, 1] - xy_px[i, 1]) - dy * (xy_px[k, 0] - xy_px[i, 0])) < reach:
                        beads[k] = True
    return beads
