"""The navigation that comes with the program: the error-state filter, or a bank of filters while an angle of
the attitude is not known; and what it says: to the log of its ticks, to the star tracker of a frame.

Its memory (`fusion.Filter`: history of the last `history_s`, health of the sensors) changes in place, because
copying it at every tick would cost more than the tick.

A log takes NavSolution and NavCovariance as records, as they come about. Who wants the figures of a mission
alone has no use for a record a tick: `Columns` writes them as rows of two tables, at a lower rate, and reads
them once, at the end. What is told does not change what the computer does.
"""

from math import acos, sqrt
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation import covariance, fusion, hypotheses, mean_rate, solution, strapdown
from shefex_nav.onboard.navigation import ticks as filter_ticks
from shefex_nav.onboard.navigation.state import ATT, MOUNTING, X_MOUNTING, X_Q, X_R, X_V
from shefex_nav.onboard.startracker.tracker import Context

COVARIANCE_TICKS = 10  # NavCovariance at every tenth tick
_FIRST_ROWS = 1024  # of a table, which doubles when they are used up; more if so many are expected
PREDICTION_FLOOR = np.radians(40.0 / 3600.0)  # rad; aberration, which the predicted places do not have


class Sky(NamedTuple):
    """What is known of the sky beforehand, constant within the mission."""

    sun_i: np.ndarray  # (3,) unit vector to the Sun
    earth_velocity_i: np.ndarray  # (3,) m/s, of the Earth relative to the solar-system barycentre


class Records:
    """Each NavSolution and each NavCovariance is handed over as it comes about."""

    def now(self, nav, tick):
        """Of the tick that the filter has reached, number `tick` of the run: list of records."""
        records = [solution.solution(nav)]
        if tick % COVARIANCE_TICKS == 0:
            records.append(covariance.covariance(nav))
        return records

    def passed(self, nav, first, last, imu_blind):
        """Of the ticks after `first` and before `last` of the run, the one that the filter has reached.

        imu_blind : as `Watch.imu_blind`, at all of them; nothing else may have arrived at them
        -> list of (tick, list of records)
        """
        later = nav.history.newest - last  # numbers of the history, beyond those of the run
        ticks = range(first + 1, last)
        found = solution.solutions(nav, range(later + first + 1, later + last), imu_blind) if ticks else []
        return [
            (tick, [one, covariance.covariance(nav, later + tick)] if tick % COVARIANCE_TICKS == 0 else [one])
            for tick, one in zip(ticks, found, strict=True)
        ]


class Columns:
    """All is kept, and nothing handed over until the end.

    every : int, ticks from one NavSolution that is kept to the next; NavCovariance comes as always
    ticks : of the whole flight, if that is known: tables need not grow
    """

    def __init__(self, every, ticks=0):
        self.every, self._ticks = every, ticks
        self._solutions = _Table(solution.WIDTH, ticks // every)
        self._covariances, self._layout = None, None

    def now(self, nav, tick):
        """Keep what there is of a tick, as `Records.now`. -> nothing to hand over"""
        if tick % self.every == 0 or tick % COVARIANCE_TICKS == 0:
            self._keep(nav, tick - 1, tick + 1, nav.history.newest - tick)
        return []

    def passed(self, nav, first, last, imu_blind):
        """Keep what there is of ticks, as `Records.passed`. -> nothing to hand over"""
        if last - first > 1:
            self._keep(nav, first, last, nav.history.newest - last, imu_blind)
        return []

    def _keep(self, nav, first, last, later, imu_blind=None):
        """Rows of the ticks after `first` and before `last`, which the history counts `later` higher."""
        if ticks := _among(first, last, self.every, later):
            solution.fill(nav, ticks, self._solutions.more(len(ticks)), imu_blind)
        if ticks := _among(first, last, COVARIANCE_TICKS, later):
            if self._layout is None:
                self._layout = nav.layout
                self._covariances = _Table(covariance.width(nav.layout), self._ticks // COVARIANCE_TICKS)
            covariance.fill(nav, ticks, self._covariances.more(len(ticks)))

    def solutions(self, first, last):
        """NavSolution of arrays of the ticks after first up to last that have been kept, and these ticks."""
        filled = self._solutions.filled[first // self.every : last // self.every]
        return solution.columns(filled), (first // self.every + 1 + np.arange(len(filled))) * self.every

    def covariances(self, first, last):
        """As `solutions`, NavCovariance; None where none has been kept yet."""
        if self._layout is None:
            return None
        filled = self._covariances.filled[first // COVARIANCE_TICKS : last // COVARIANCE_TICKS]
        ticks = (first // COVARIANCE_TICKS + 1 + np.arange(len(filled))) * COVARIANCE_TICKS
        return covariance.columns(self._layout, filled), ticks

    def read(self):
        """NavSolution and NavCovariance of arrays, of all that has been kept: list."""
        arrays = [solution.columns(self._solutions.filled)]
        if self._layout is not None:
            arrays.append(covariance.columns(self._layout, self._covariances.filled))
        return arrays


class Nothing:
    """Nothing is told."""

    def now(self, nav, tick):
        """As `Records.now`."""
        return []

    def passed(self, nav, first, last, imu_blind):
        """As `Records.passed`."""
        return []


RECORDS, NOTHING = Records(), Nothing()


def start(params, alignment, earth, telemetry=RECORDS):
    """Navigator at the instant of the alignment. NavParams, Alignment, EarthRotation -> Navigator"""
    nav, bank = hypotheses.start(params, alignment, earth)
    return Navigator(nav, telemetry, bank)


class Navigator:
    """The built-in navigation, a `driving.Software`.

    nav : fusion.Filter; of a bank the best one
    telemetry : who is told of the ticks, `Records`, `Columns` or `Nothing`
    bank : hypotheses.Bank while an angle of the attitude is not known
    """

    def __init__(self, nav, telemetry=RECORDS, bank=None):
        self.nav, self.bank = nav, bank
        self._telemetry, self._ticks = telemetry, 0

    def advance(self, blocks, first, last):
        """As of `driving.Software`."""
        if self.bank is not None:
            self.bank.advance(blocks, first)
            self._ticks += 1
            return 1, []
        blind = self.nav.watch.imu_blind  # until the last tick: it ends there if that changes
        done = filter_ticks.advance(self.nav, blocks, first, last)
        begin, self._ticks = self._ticks, self._ticks + done
        passed = self._telemetry.passed(self.nav, begin, self._ticks, blind)
        return done, [(first + tick - begin - 1, records) for tick, records in passed]

    def update(self, arrived):
        """As of `driving.Software`, of GpsFix, GpsRanges, readings of instruments and StarFix.

        -> list of GateResult and NavHealth, then what the telemetry hands over
        """
        if self.bank is not None:
            return self._search(arrived)
        outputs = fusion.take(self.nav, arrived) if arrived else []
        outputs += self.nav.watch.changes()
        return outputs + self._telemetry.now(self.nav, self._ticks)

    def _search(self, arrived):
        """`update` while an angle of the attitude is not known."""
        bank, outputs, found = self.bank, [], None
        if arrived:
            outputs, found = bank.fuse(arrived), bank.settled()
        if found is None:
            self.nav = bank.best
            return outputs + self._telemetry.now(bank.mixed_filter(), self._ticks)
        self.nav, self.bank = found, None
        return outputs + self._telemetry.now(found, self._ticks)

    def close(self):
        """There are no more ticks."""

    def context(self, frame, sky, predicts=True):
        """What the navigation knows about a frame: `tracker.Context`.

        sky : Sky; predicts : False for a chain that does not search by the predicted attitude
        """
        return (full_context if predicts else brief_context)(self.nav, frame, sky)


def full_context(nav, frame, sky):
    """Context of a frame with prediction and rate.

    Place and geometry are those of the tick nearest to its instant: within 5 ms they do not change. The
    attitude is carried on to the instant itself, and the rate is the mean from the opening of the first row
    to the closing of the last.

    fusion.Filter, Frame, Sky -> tracker.Context
    """
    history, C_bc = nav.history, nav.params.C_bc
    ticks = history.oldest, history.newest, history.nearest(frame.t_valid_s)
    shot = frame.t_valid_s, frame.t_start_s, frame.exposure_s, frame.line_s, frame.image_dn.shape[0]
    context, known = _full_context(nav.constants, history.arrays, ticks, C_bc, shot, sky)
    if not known:
        return context._replace(omega_c=None, P_omega_c=None, unsteady_c=None)
    return context if np.isfinite(context.unsteady_variance) else context._replace(unsteady_c=None)


def brief_context(nav, frame, sky):
    """`full_context` without prediction and rate, for a chain that does not search by them."""
    history, t_valid_s = nav.history, frame.t_valid_s
    place = history.nearest(t_valid_s)
    v_i, _, _, *angles = _sight(history.arrays, place, nav.params.C_bc, t_valid_s, nav.earth, sky.sun_i)
    return Context(v_i + sky.earth_velocity_i, *angles)


@kernel
def _full_context(constants, memory, ticks, C_bc_nominal, shot, sky):
    """`full_context`, and whether the memory covers the exposure.

    constants, memory : prediction.Constants, prediction.Memory
    ticks : numbers of its oldest and newest tick, place of the one that ends nearest to the frame's instant
    shot : mission times of the frame's instant and of the opening of its first row, exposure [s], from one
        row to the next [s], number of rows
    sky : Sky
    """
    oldest, newest, place = ticks
    t_valid_s, t_start_s, exposure_s, line_s, n_rows = shot
    v_i, C_bc, C_ic, rate, sun_angle, limb_angle = _sight(
        memory, place, C_bc_nominal, t_valid_s, constants.earth, sky.sun_i
    )
    near = mean_rate.Estimates(
        memory.xs[place], memory.Ps[place], memory.numbers[place, 3], memory.drives[place]
    )
    exposed_s = t_start_s, t_start_s + (exposure_s + (n_rows - 1) * line_s), t_valid_s
    known, omega_c, P_omega_c, unsteady_c, variance = mean_rate.camera_rate(
        constants, memory, (oldest, newest), near, C_bc, exposed_s
    )
    P_c = camera_covariance(constants.at, near.P, C_bc_nominal)
    for i in range(3):
        P_c[i, i] += PREDICTION_FLOOR**2
    v_i += sky.earth_velocity_i
    q_ic = rotation.quat_from_dcm(C_ic)
    return Context(
        v_i, rate, sun_angle, limb_angle, q_ic, P_c, omega_c, P_omega_c, unsteady_c, variance
    ), known


@kernel
def _sight(memory, place, C_bc_nominal, t_valid_s, earth, sun_i):
    """Velocity, mounting, attitude at t_valid_s; rate, angles of the boresight to Sun and limb.

    memory : prediction.Memory;  place : in it, of the tick that ends nearest to t_valid_s
    """
    x, t_s, dt_s = memory.xs[place], memory.numbers[place, 0], memory.numbers[place, 1]
    n, vibration = int(memory.numbers[place, 2]), memory.numbers[place, 3]
    drive = memory.drives[place]
    omega_b = strapdown.sensed_packed(x, memory.increments[place], n, dt_s, vibration, drive, n * dt_s)[:3]
    C_bc = rotation.dcm_from_rotvec(x[X_MOUNTING]) @ C_bc_nominal
    turned = rotation.dcm_from_rotvec(omega_b * (t_valid_s - t_s))
    C_ic = rotation.dcm_from_quat(x[X_Q]) @ turned @ C_bc
    C_ei = np.ascontiguousarray(frames.dcm_ie(earth, t_s).T)
    boresight_i = np.ascontiguousarray(C_ic[:, 2])
    sun_angle = acos(min(1.0, max(-1.0, boresight_i @ sun_i)))
    limb_angle = wgs84.limb_angle(C_ei @ x[X_R], C_ei @ boresight_i)
    return x[X_V].copy(), C_bc, C_ic, sqrt(omega_b @ omega_b), sun_angle, limb_angle


@inner
def camera_covariance(at, P, C_bc):
    """Covariance of the camera's attitude error in camera axes: attitude and mounting add up.

    at : of Layout;  P : (n, n) of the filter;  C_bc : (3, 3) nominal mounting -> (3, 3) rad^2
    """
    P_b, first = P[ATT, ATT].copy(), at[MOUNTING]
    if first >= 0:
        mounting = slice(first, first + 3)
        P_b += P[ATT, mounting]
        P_b += P[mounting, ATT]
        P_b += P[mounting, mounting]
    return C_bc.T @ P_b @ C_bc


def _among(first, last, every, later):
    """Multiples of `every` after `first` and before `last`, all `later` higher: range."""
    return range(later + (first // every + 1) * every, later + last, every)


class _Table:
    """Rows of numbers, one after the other."""

    def __init__(self, width, expected=0):
        self._rows, self._n = np.empty((max(expected, _FIRST_ROWS), width)), 0

    def more(self, count):
        """The next `count` rows, to be written."""
        if self._n + count > len(self._rows):
            self._rows = np.concatenate(
                [self._rows, np.empty((count + len(self._rows), self._rows.shape[1]))]
            )
        self._n += count
        return self._rows[self._n - count : self._n]

    @property
    def filled(self):
        """The rows that have been written."""
        return self._rows[: self._n]
