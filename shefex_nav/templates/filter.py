"""Navigation software of your own: an error-state filter with 15 states, to start from.

    shefex-nav run shefex2_andoya --set navigation.software=FILE:MyFilter --trust

`start` is called once, at the alignment on the pad; `step` at every tick, 100 times a second. SI units and
radians. Axes: i inertial, e Earth-fixed, b body (x along the nose), c star camera; `C_ab` turns components in
b into components in a; quaternions are Hamilton, scalar first. An error is truth minus estimate; that of the
attitude is a rotation vector in inertial axes, C_true = (I + [psi x]) C, which does not turn with the rocket.
"""

from collections import deque

import numpy as np

from shefex_nav.geometry import frames
from shefex_nav.geometry.rotation import (
    dcm_from_quat,
    dcm_from_rotvec,
    quat_from_dcm,
    quat_from_rotvec,
    quat_multiply,
    quat_normalise,
    rotvec_from_quat,
    skew,
)
from shefex_nav.records import GateResult, GpsFix, Reason, StarFix
from shefex_nav.software import Estimate

MU, J2, RADIUS = 3.986004418e14, 1.08263e-3, 6378137.0  # of the Earth: m^3/s^2, 1, m (WGS84, EGM96)
POS, VEL, ATT, GYRO, ACC = (slice(k, k + 3) for k in range(0, 15, 3))  # errors in the state
LASTING_S = 100.0  # for so long an error of scale factor or gravity is taken to be the same
GRAVITY_ERROR = 1e-4  # m/s^2, that J2 leaves out
GATE = 25.0  # a measurement with three components and a larger NIS is refused (chance 2e-5)
KEPT = 100  # ticks, for measurements that come late


class MyFilter:
    """Strapdown, and corrections by GPS fixes and star fixes."""

    def start(self, alignment, mission):
        self.mission = mission
        self.r, self.v, self.q = alignment.r_i, alignment.v_i, alignment.q_ib
        self.gyro_bias, self.accel_bias = np.zeros(3), np.zeros(3)
        gyro, accelerometer = mission.sheets["imu"].gyro, mission.sheets["imu"].accelerometer
        self.P = np.zeros((15, 15))
        # what stands still on the Earth moves with it: elsewhere, it moves otherwise
        moves = np.vstack([np.eye(3), skew(alignment.omega_i)])
        self.P[:6, :6] = alignment.sigma_r**2 * moves @ moves.T
        self.P[VEL, VEL] += alignment.sigma_v**2 * np.eye(3)
        C = dcm_from_quat(self.q)
        self.P[ATT, ATT] = C @ alignment.P_theta_b @ C.T
        self.P[GYRO, GYRO] = (gyro.bias**2 + gyro.in_run_bias**2) * np.eye(3)
        self.P[ACC, ACC] = (accelerometer.bias**2 + accelerometer.in_run_bias**2) * np.eye(3)
        if len(alignment.gyro_bias):  # found at rest
            self.gyro_bias = alignment.gyro_bias
            self.P[GYRO, GYRO] = alignment.sigma_gyro_bias**2 * np.eye(3)
        if len(alignment.P_with_biases):  # the attitude was found by these sensors: their biases tilt it
            to_inertial = np.eye(9)
            to_inertial[:3, :3] = C
            self.P[6:, 6:] = to_inertial @ alignment.P_with_biases @ to_inertial.T
        self.pushed = np.zeros(3)  # m/s, all that the accelerometers have felt, in inertial axes
        self.past = deque(maxlen=KEPT)  # (time, r, v, C_ib, rate, pushed) of the last ticks
        self.star_aided = False

    def step(self, imu, arrived):
        self.predict(imu)
        self.gates = []  # what came of the measurements of this tick, for the log
        for one in arrived:
            if isinstance(one, GpsFix) and one.valid and not one.horizontal and not self.is_too_old(one):
                self.correct_by_gps(one)
            if isinstance(one, StarFix) and one.reason == Reason.NONE and not self.is_too_old(one):
                self.correct_by_stars(one)
        to_body = np.eye(9)
        to_body[ATT, ATT] = dcm_from_quat(self.q).T
        estimate = Estimate(
            r_i=self.r,
            v_i=self.v,
            q_ib=self.q,
            P=to_body @ self.P[:9, :9] @ to_body.T,  # attitude error in body axes
            gyro_bias=self.gyro_bias,
            accel_bias=self.accel_bias,
            star_aided=self.star_aided,
        )
        return [estimate, *self.gates]

    def predict(self, imu):
        dt = imu.dt_s * len(imu.dtheta_b)
        # a unit that does not answer: go on as if nothing happened, and let P say that it is not known
        turn, push = imu.dtheta_b.sum(axis=0), imu.dv_b.sum(axis=0)
        if not imu.valid:
            turn, push = np.zeros(3), np.zeros(3)
        omega, force = turn / dt - self.gyro_bias, push / dt - self.accel_bias
        C = dcm_from_quat(quat_multiply(self.q, quat_from_rotvec(0.5 * omega * dt)))  # in the middle
        self.propagate_covariance(C, omega, force, dt, imu.valid)
        acceleration = C @ force + gravity(self.r)
        self.r = self.r + self.v * dt + 0.5 * acceleration * dt**2
        self.v = self.v + acceleration * dt
        self.q = quat_normalise(quat_multiply(self.q, quat_from_rotvec(omega * dt)))
        self.pushed = self.pushed + C @ force * dt
        self.past.append((imu.t_valid_s, self.r, self.v, dcm_from_quat(self.q), omega, self.pushed))

    def propagate_covariance(self, C, omega, force, dt, valid):
        gyro, accelerometer = self.mission.sheets["imu"].gyro, self.mission.sheets["imu"].accelerometer
        up = self.r / np.linalg.norm(self.r)
        F = np.eye(15)
        F[POS, VEL] = dt * np.eye(3)
        F[VEL, POS] = dt * MU / np.linalg.norm(self.r) ** 3 * (3.0 * np.outer(up, up) - np.eye(3))
        F[VEL, ATT] = -dt * skew(C @ force)
        F[VEL, ACC] = -dt * C
        F[ATT, GYRO] = -dt * C
        # scale factors have no states here: they are noise that lasts
        scale = np.array([gyro.scale_factor_roll, gyro.scale_factor, gyro.scale_factor])
        turns = gyro.random_walk**2 + LASTING_S * (scale * omega) ** 2
        scale2 = accelerometer.scale_factor**2 + 2.0 * accelerometer.misalignment**2
        pushes = accelerometer.random_walk**2 + LASTING_S * (scale2 * (force @ force) + GRAVITY_ERROR**2)
        if not valid:
            turns, pushes = np.full(3, 1.0), 100.0
        P = F @ self.P @ F.T
        self.P = 0.5 * (P + P.T)
        self.P[ATT, ATT] += dt * C @ np.diag(turns) @ C.T
        self.P[VEL, VEL] += dt * pushes * np.eye(3)

    def at(self, t_s):
        """What is believed of the instant of a measurement, which comes late: r, v, C_ib, rate, pushed."""
        near_s, r, v, C, omega, pushed = min(self.past, key=lambda one: abs(one[0] - t_s))
        after_s = t_s - near_s  # at most half a tick, in which a spinning rocket turns by degrees
        return r + v * after_s, v, C @ dcm_from_rotvec(omega * after_s), omega, pushed

    def is_too_old(self, fix):
        """Whether the instant of a measurement is before all that is remembered."""
        return fix.t_valid_s < self.past[0][0] - 0.01

    def correct_by_gps(self, fix):
        arm, C_ie = self.mission.l_ba_b, frames.dcm_ie(self.mission.earth, fix.t_valid_s)
        r_fix, v_fix = frames.inertial_from_ecef(self.mission.earth, fix.t_valid_s, fix.r_ea_e, fix.v_ea_e)
        late_s = self.past[-1][0] - fix.t_valid_s
        # errors of then by those of now: dr - late dv, and dv + (what was felt since) x psi
        r, _, C, _, _ = self.at(fix.t_valid_s)
        r_arm = C @ arm  # from the IMU to the antenna
        H = np.zeros((3, 15))
        H[:, POS], H[:, VEL], H[:, ATT] = np.eye(3), -late_s * np.eye(3), -skew(r_arm)
        self.correct("gps_position", fix, r_fix - r - r_arm, H, C_ie @ fix.R_r_e @ C_ie.T)
        if not np.isfinite(v_fix).all():
            return  # a receiver that gives positions alone
        _, v, C, omega, pushed = self.at(fix.t_valid_s)
        v_arm = C @ np.cross(omega, arm)
        H = np.zeros((3, 15))
        H[:, VEL], H[:, ATT] = np.eye(3), skew(self.pushed - pushed - v_arm)
        self.correct("gps_velocity", fix, v_fix - v - v_arm, H, C_ie @ fix.R_v_e @ C_ie.T)

    def correct_by_stars(self, fix):
        _, _, believed, _, _ = self.at(fix.t_valid_s)
        C_bc = self.mission.C_bc
        seen = dcm_from_quat(fix.q_ic) @ C_bc.T
        H = np.zeros((3, 15))
        H[:, ATT] = np.eye(3)
        # the mounting is off by the same all the time: as many fixes as come while it counts are no better
        C_ic, fixes = believed @ C_bc, LASTING_S * self.mission.sheets["star_tracker"].rate
        R = C_ic @ fix.P_c @ C_ic.T + fixes * self.mission.sigma_mounting**2 * np.eye(3)
        residual = rotvec_from_quat(quat_from_dcm(seen @ believed.T))
        self.star_aided |= self.correct("star_tracker", fix, residual, H, R)

    def correct(self, sensor, fix, residual, H, R):
        """Kalman update; a measurement that contradicts the filter is refused. -> whether it was used"""
        S = H @ self.P @ H.T + R
        nis = float(residual @ np.linalg.solve(S, residual))  # on average 3 if P and R are right
        used = nis <= GATE
        self.gates.append(
            GateResult(self.past[-1][0], fix.t_valid_s, sensor, 3, nis, GATE, used, "", residual)
        )
        if not used:
            return False
        K = np.linalg.solve(S, H @ self.P).T
        error, keep = K @ residual, np.eye(15) - K @ H
        self.P = keep @ self.P @ keep.T + K @ R @ K.T
        self.r, self.v = self.r + error[POS], self.v + error[VEL]
        self.q = quat_normalise(quat_multiply(quat_from_rotvec(error[ATT]), self.q))
        self.gyro_bias, self.accel_bias = self.gyro_bias + error[GYRO], self.accel_bias + error[ACC]
        self.correct_past(error[POS], error[VEL], error[ATT])
        return True

    def correct_past(self, dr, dv, psi):
        """The last ticks too: the next late measurement must not find the same error again."""
        now_s, turn = self.past[-1][0], dcm_from_rotvec(psi)
        for k, (t_s, r, v, C, omega, pushed) in enumerate(self.past):
            dv_then = dv + np.cross(self.pushed - pushed, psi)
            self.past[k] = (t_s, r + dr - dv * (now_s - t_s), v + dv_then, turn @ C, omega, pushed)


def gravity(r_i):
    """Of the flattened Earth, (3,) m/s^2; the difference of inertial axes and the pole does not matter."""
    r = np.linalg.norm(r_i)
    z2, flat = (r_i[2] / r) ** 2, 1.5 * J2 * (RADIUS / r) ** 2
    return -MU / r**3 * r_i * (1.0 + flat * (np.array([1.0, 1.0, 3.0]) - 5.0 * z2))
