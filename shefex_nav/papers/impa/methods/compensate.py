"""All streaks to one instant, from their own length: the Improved Multi-Poles paper, equations (5)-(22).

In: the extents of the streaks and their shifts since the frame before, from the cluster fusion. Out: their
places at the frame's instant. A star that moves with the order of the rows is seen for longer than a row's
exposure, by dT = dk t_l, one that moves against it for less; its velocity is its extent over that time. The
middle of its light belongs to the time at which the row of its centroid is half exposed, so it is carried
from there to the time of the middle row.

Axes: the paper's y is the column, our x; its z is the row, our y, and counts from the first row exposed, so
its n_row / 2 is our `RowTimes.middle_row` and its T_exp is exposure_s. The paper has T_exp = t_l n_row; here
exposure and line time are free.

The paper takes the extent of the pixels above the threshold, from the middle of the first to the middle of
the last, for the star's own way. It is longer by what the spot adds at the ends, two to four pixels for a
bright star, in both directions, and shorter where the faint ends of a streak stay below the threshold. At the
first and last rows, carried by half of T_exp, that is one to two pixels, in the mean over the rows a third of
it: the greater part of the errors of its Table 4, which for this reason hardly depend on the rate. It is left
as it is. The covariances have it star by star; it is much the same for all stars, so the attitude is solved
with a common error of the rate besides (`objects`).
"""

from typing import NamedTuple

import numpy as np

FORMS = ("explicit", "implicit")
END_PX = 0.18  # 1 sigma of a centroid along the streak: each end is a pixel or not; measured [E]
EXTENT_PX = 2.0  # RMS of what the extents are too long or too short; measured [E]


class Streaks(NamedTuple):
    """Objects at the frame's instant."""

    xy_px: np.ndarray  # (n, 2); NaN where no star can make such a streak
    velocity_px_s: np.ndarray  # (n, 2); a component below v* is zero
    seen_s: np.ndarray  # (n,) T_exp + s_z dT, how long the light was collected
    P_px: np.ndarray  # (n, 2, 2) px^2


def compensate(settings, times, xy_px, extent_px, shift_px, sigma_px, form="explicit", row_time=1.0):
    """Velocities of streaks, and their places at the frame's instant.

    With c_z the centroid as measured, equation (22) is right for a constant velocity; with c~_z the time is
    that of the row where the star ends up: 1.3 px different at 5 deg/s in the first and last rows of the
    paper's camera. With a global shutter nothing moves.

    The paper trusts v_y and v_z as long as they are greater than v*, without saying what else. An extent
    cannot tell (a bright star at rest is seven pixels wide), so a component is held against v* by the shift
    of the centroid since the frame before, whose sign it has anyway, and is zero below it.

    Parameters
    ----------
    settings : RunLength; v* is its slowest
    times : RowTimes
    xy_px : (n, 2) centroids
    extent_px : (n, 2) last less first column and last less first row of each: L_y and L_z over the pixel's
        side, the latter dk
    shift_px : (n, 2) of the centroids since the frame before, one exposure earlier: second less first, where
        equation (3) is printed the other way round
    sigma_px : (n, 2) standard deviation of the centroids
    form : of equation (22): "explicit", with c_z; "implicit", with the compensated c~_z, as it is printed
    row_time : factor of s_z dT in (11) to (17): 1, another reading has 0 or -1

    Returns
    -------
    Streaks
    """
    if form not in FORMS:
        raise ValueError(f"compensation: {form!r} is not known; choose from: {', '.join(FORMS)}")
    shift_px = np.asarray(shift_px, dtype=float)
    sign = np.where(np.abs(shift_px) >= settings.slowest * times.exposure_s, np.sign(shift_px), 0.0)
    seen_s = times.exposure_s + row_time * sign[:, 1] * extent_px[:, 1] * times.line_s  # (11) to (15)
    seen_s = np.where(seen_s > 0.0, seen_s, np.nan)  # against the rows, longer than any star can be
    velocity = sign * extent_px / seen_s[:, None]  # (16) and (17), s_z put in
    late_s = times.line_s * (times.middle_row - xy_px[:, 1])  # (22)
    if form == "implicit":
        late_s = late_s / (1.0 + velocity[:, 1] * times.line_s)
    wrong = np.where(sign != 0.0, EXTENT_PX / seen_s[:, None], shift_px / times.exposure_s)
    P_px = _covariance(velocity, wrong * late_s[:, None], sigma_px)
    return Streaks(xy_px + velocity * late_s[:, None], velocity, seen_s, P_px)


def _covariance(velocity, carried_wrong_px, sigma_px):
    """Covariance of the places, (n, 2, 2) px^2.

    The centroid itself, the open ends along the streak, and in x and y alike the error of the velocity, which
    for a component below v* is what was left out.
    """
    speed = np.linalg.norm(velocity, axis=1)[:, None]
    along = np.divide(velocity, speed, out=np.zeros_like(velocity), where=speed > 0.0)
    P_px = END_PX**2 * along[:, :, None] * along[:, None, :]
    for axis in range(2):
        P_px[:, axis, axis] += sigma_px[:, axis] ** 2 + carried_wrong_px[:, axis] ** 2
    return P_px
