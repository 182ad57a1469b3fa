"""Where a value lies in an ascending column of a table; for the kernels of the flight.

The tables of a section stand one after the other in a single flat array, see `scene`.
"""

from shefex_nav.compiled import inner, kernel


@kernel(error_model="numpy", forceinline=True)
def place(tables, at, n, step, x):
    """(k, part): x lies part of the way from value k to value k + 1; 0 or 1 beyond the ends.

    The n >= 2 ascending values are tables[at], tables[at + step] and so on.
    """
    low, high = 0, n - 1
    if x <= tables[at]:
        return 0, 0.0
    if x >= tables[at + step * high]:
        return high - 1, 1.0
    while high - low > 1:
        middle = (low + high) // 2
        if x < tables[at + step * middle]:
            high = middle
        else:
            low = middle
    below = tables[at + step * low]
    return low, (x - below) / (tables[at + step * high] - below)


@inner(error_model="numpy", forceinline=True)
def mixed(tables, at, step, part):
    """Value part of the way from tables[at] to tables[at + step]."""
    return tables[at] + part * (tables[at + step] - tables[at])
