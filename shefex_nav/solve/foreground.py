"""Which objects of a picture are no stars: gaps between leaves, beads of a trail, blocks of a JPEG, clouds.

In: the picture without its background, and objects in it. Out: what speaks against each. None of it is
certain: `field` puts what is doubted behind the rest.
"""

import numpy as np

from shefex_nav.compiled import inner, kernel

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
    if len(xy_px) == 0 or not np.isfinite(sky).any():
        return np.ones(len(xy_px), dtype=bool)
    column, row = np.rint(xy_px).astype(int).T
    near = [(row + i, column + j) for i in (-1, 0, 1) for j in (-1, 0, 1)]  # detections are not at the border
    peak = np.max([grey[r, c] for r, c in near], axis=0)
    tile = row * sky.shape[0] // grey.shape[0], column * sky.shape[1] // grey.shape[1]
    return peak > sky[tile] + ABOVE_SIGMA * noise


@kernel
def prominence(flat, xy_px, radius_px, floor):
    """Height of each object above what is around it, over the scatter of that. -> (n,), 0 where little is.

    Both of means of nine pixels, the latter on a grid over the picture: a block of a JPEG, a cloud's ridge or
    a gap between leaves is no higher than others beside it, whatever the noise of single pixels. The scatter
    is by the quantile of 90 %, which stars do not reach; it is not below the floor.
    """
    rows, columns = flat.shape
    grid = _means(flat)
    found = np.zeros(xy_px.shape[0])
    means = np.empty((2 * AROUND_PX // EVERY_PX + 1) ** 2, dtype=grid.dtype)
    for k in range(xy_px.shape[0]):
        column, row, m = int(xy_px[k, 0] + 0.5), int(xy_px[k, 1] + 0.5), 0
        if row < 1 or column < 1 or row > rows - 2 or column > columns - 2:
            continue
        own2 = (radius_px[k] + OWN_PX) ** 2
        top, bottom = _nodes(row, grid.shape[0])
        left, right = _nodes(column, grid.shape[1])
        for i in range(top, bottom):
            r2 = (1 + EVERY_PX * i - row) ** 2
            for j in range(left, right):
                if r2 + (1 + EVERY_PX * j - column) ** 2 >= own2:
                    means[m] = grid[i, j]
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
def _means(flat):
    """Means of nine pixels about every EVERY_PX-th row and column, from 1 on."""
    rows, columns = flat.shape
    grid = np.empty(((rows - 3) // EVERY_PX + 1, (columns - 3) // EVERY_PX + 1), dtype=np.float32)
    for i in range(grid.shape[0]):
        for j in range(grid.shape[1]):
            grid[i, j] = _nine(flat, 1 + EVERY_PX * i, 1 + EVERY_PX * j)
    return grid


@inner
def _nodes(at, n):
    """First node of the grid within AROUND_PX of a row or column, and the one after the last. n : nodes"""
    return max((at - 1 - AROUND_PX + EVERY_PX - 1) // EVERY_PX, 0), min(
        (at - 1 + AROUND_PX) // EVERY_PX + 1, n
    )


@inner
def nth(values, k, n):
    """Number k, counted from 0, of the first n values in ascending order; those before it become no larger.

    Hoare's selection: only the side of the pivot that holds it is looked at again.
    """
    low, high = 0, n - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            break
    return values[k]


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
    x, y = xy_px[:m, 0].copy(), xy_px[:m, 1].copy()
    for i in range(m):
        for j in range(i):
            dx, dy = x[j] - x[i], y[j] - y[i]
            reach = LINE_PX * np.sqrt(dx * dx + dy * dy)
            near = 0
            for k in range(m):
                near += abs(dx * (y[k] - y[i]) - dy * (x[k] - x[i])) < reach
            if near >= LINE_OF:
                for k in range(m):
                    if abs(dx * (y[k] - y[i]) - dy * (x[k] - x[i])) < reach:
                        beads[k] = True
    return beads
