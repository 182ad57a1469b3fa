"""How a picture is turned between its file and a screen: the orientation of EXIF 2.32, 4.6.4 (tag 274).

A camera that is held upright stores the rows of its detector as ever and says so by this number; viewers turn
the picture. 1 is as stored, 3 upside down, 6 and 8 a quarter to the right and to the left; 2, 4, 5 and 7 are
mirrored besides. Other numbers mean nothing and are taken for 1, as viewers do.
"""

import numpy as np

AS_STORED = 1
_BACK = {6: 8, 8: 6}  # the others undo themselves


def displayed(values, orientation):
    """A stored picture (rows, columns[, channels]) as it is displayed: a view of the same numbers."""
    turn = {
        2: lambda v: v[:, ::-1],
        3: lambda v: v[::-1, ::-1],
        4: lambda v: v[::-1],
        5: lambda v: np.swapaxes(v, 0, 1),
        6: lambda v: np.rot90(v, -1),
        7: lambda v: np.swapaxes(v[::-1, ::-1], 0, 1),
        8: lambda v: np.rot90(v),
    }.get(orientation)
    return values if turn is None else turn(values)


def stored(values, orientation):
    """A displayed picture as it is stored: the inverse of `displayed`."""
    return displayed(values, _BACK.get(orientation, orientation))
