"""When each row of a detector collects light.

Time zero is the frame's instant: the middle of the exposure of the middle of the detector. Row k collects
light from its start for exposure_s; with a global shutter line_s is zero and all rows are as one.
"""

from typing import NamedTuple

from shefex_nav.compiled import kernel


class RowTimes(NamedTuple):
    """Exposure of the rows of one frame."""

    exposure_s: float  # of every row
    line_s: float  # from the start of one row to the start of the next; 0: global shutter
    middle_row: float  # (rows - 1) / 2


@kernel
def row_times(exposure_s, line_s, n_rows):
    """RowTimes of a detector with n_rows rows."""
    return RowTimes(float(exposure_s), float(line_s), 0.5 * (n_rows - 1))


@kernel
def row_start_s(times, row):
    """Start of the exposure of a row, whole or between two. RowTimes, px -> s from the frame's instant."""
    return (row - times.middle_row) * times.line_s - 0.5 * times.exposure_s


def instant_after_s(times):
    """From the opening of the first row to the frame's instant. RowTimes -> s."""
    return 0.5 * times.exposure_s + times.middle_row * times.line_s


def duration_s(times):
    """From the opening of the first row to the closing of the last. RowTimes -> s."""
    return times.exposure_s + 2.0 * times.middle_row * times.line_s
