"""What the filter tells of its errors: NavCovariance, ten times a second.

A kernel writes each as a row of numbers, which are read as one record or, many, as a record of arrays.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.onboard.navigation import momentary
from shefex_nav.onboard.navigation.state import (
    ATT,
    BA,
    BG,
    MOUNTING,
    PVA,
    ROLL_COLUMN,
    VEL,
    X_BA,
    X_BG,
    X_MOUNTING,
    X_ROLL,
)
from shefex_nav.records import NavCovariance

FOUR = np.array([X_BG, X_BA, X_ROLL, X_MOUNTING.start])  # calibrations that always have a name, packed places
# where a row holds P, the four, their sigmas, and behind them the blocks of choice; the time comes first
P_AT, FOUR_AT, SIGMA_AT, CHOICE_AT = 1, 1 + PVA.stop**2, 13 + PVA.stop**2, 25 + PVA.stop**2


def width(layout):
    """Numbers in a row of `fill`."""
    return CHOICE_AT + 2 * (layout.n - BA.stop)


def reported(nav):
    """Covariance of the errors of the solution, (n, n); not to be changed, it may be that of the filter.

    Errors of the moment, which the filter does not count, are in it (`momentary`).
    """
    vibration = float(nav.history.numbers[nav.history.place(-1), 3])
    return as_reported(nav.history.P, *momentary.variances(nav.constants.momentary, vibration))


def covariance(nav, tick=None):
    """NavCovariance of a tick, numbered as `History` counts them, or of the last one."""
    tick = nav.history.newest if tick is None else tick
    rows = np.empty((1, width(nav.layout)))
    fill(nav, range(tick, tick + 1), rows)
    return NavCovariance(rows[0, 0].item(), *_fields(rows[0], " ".join(nav.layout.names)))


def fill(nav, ticks, rows):
    """Write a row for each of some ticks, in one compiled call.

    fusion.Filter; range of their numbers, as `History` counts them; rows (m, `width`)
    """
    layout, added = nav.layout, (nav.constants.momentary, nav.params.imu.gravity)
    _fill(layout.at, layout.nominal, ticks.start, ticks.step, nav.history.arrays, added, rows)


def columns(layout, rows):
    """NavCovariance of arrays over N: of rows (N, `width`) of `fill`."""
    fields = _fields(rows, np.full(len(rows), " ".join(layout.names)))
    return NavCovariance(rows[:, 0].copy(), *(np.ascontiguousarray(field) for field in fields))


def _fields(rows, states):
    """All fields of NavCovariance but the time, of one row or of many."""
    many, k = rows.shape[:-1], CHOICE_AT + (rows.shape[-1] - CHOICE_AT) // 2
    return (
        rows[..., P_AT:FOUR_AT].reshape(*many, PVA.stop, PVA.stop),
        *(rows[..., at : at + 3] for at in range(FOUR_AT, SIGMA_AT, 3)),
        rows[..., SIGMA_AT:CHOICE_AT],
        states,
        rows[..., CHOICE_AT:k],
        rows[..., k:],
    )


@kernel
def as_reported(P, velocity2, attitude2):
    """`reported`: P (n, n) itself, or a copy with variances of the moment, m^2/s^2 and rad^2, on top."""
    if velocity2 == 0.0 and attitude2 == 0.0:
        return P
    P = P.copy()
    for i in range(3):
        P[VEL.start + i, VEL.start + i] += velocity2
        P[ATT.start + i, ATT.start + i] += attitude2
    return P


@kernel
def _fill(at, nominal, first, step, memory, added, rows):
    """Rows of NavCovariance of ticks of a History: rows (m, `width`) is written.

    at, nominal : of Layout;  first, step : numbers of the ticks;  memory : prediction.Memory
    added : what is reported on top of the covariance of the filter: variances of `momentary`, and the sigma
        [m/s^2] of gravity that the estimate of the accelerometer bias contains
    """
    of_moment, gravity = added
    numbers, xs, Ps = memory.numbers, memory.xs, memory.Ps
    for j in range(len(rows)):
        place, row = (first + j * step) % len(numbers), rows[j]
        x = xs[place]
        velocity2, attitude2 = momentary.variances(of_moment, numbers[place, 3])
        P = as_reported(Ps[place], velocity2, attitude2)
        row[0] = numbers[place, 0]
        for i in range(PVA.stop):
            for k in range(PVA.stop):
                row[P_AT + PVA.stop * i + k] = P[i, k]
        blocks = (BG.start, BA.start, at[ROLL_COLUMN], at[MOUNTING])
        for m in range(4):
            for i in range(3):
                row[FOUR_AT + 3 * m + i] = x[FOUR[m] + i]
                sigma = np.nan
                if blocks[m] >= 0:
                    variance = P[blocks[m] + i, blocks[m] + i]
                    sigma = np.sqrt(variance + gravity**2 if blocks[m] == BA.start else variance)
                row[SIGMA_AT + 3 * m + i] = sigma
        n = P.shape[0]
        for k in range(BA.stop, n):
            row[CHOICE_AT + k - BA.stop] = x[nominal[k - BG.start]]
            row[CHOICE_AT + n - 2 * BA.stop + k] = np.sqrt(P[k, k])
