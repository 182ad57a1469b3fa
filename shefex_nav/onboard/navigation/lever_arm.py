"""What the lever arm of the GPS antenna adds to the noise of a measurement, and what vibration does.

The strapdown knows the IMU; GPS sees the antenna, C_ib l away from it, whose velocity against the IMU is
C_ib (omega_ib_b x l). That of the noise in the rate is noise of the predicted velocity,

    C_ib [l x] Q [l x]^T C_ib^T,    Q the variances of the rate,

which are those of `mean_rate.rate_noise` and what may be missed of a gyro that cannot be read. The rate is a
mean over the time of one sample, centred on the instant of the fix. As a rule half of it comes from the
sample before the instant and half from the one after it. Where that one has not been measured yet, the rate
is that of the last sample, and half of its change counts as noise. The velocity of the sensors has its errors
of the moment (`momentary`). All satellites of a set see the same antenna, so their range rates err
together.

What is not linear while the attitude is hardly known is in `unknown_attitude.of_arm`.
"""

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import error_model, mean_rate, momentary, unknown_attitude
from shefex_nav.onboard.navigation.state import POS, VEL, X_Q

NOTHING = np.zeros(3)


def of_position(nav, now, H):
    """Noise of the rows H (m, n) that measure the position of the antenna: (m, m).

    nav : fusion.Filter;  now : Moment
    """
    return unknown_attitude.of_arm(now.P, nav.params.l_ba_b) * (H[:, POS] @ H[:, POS].T)


def of_velocity(nav, now, H):
    """Likewise of the rows that measure its velocity."""
    arm, x, sensed, about = nav.params.l_ba_b, now.x, now.sensed_packed, now.about()
    more = _unread(now.imu, nav.watch.params.imu) if now.extra[0].any() else NOTHING
    mean_s = about.dt_s / ((1.0 - about.share) ** 2 + about.share**2)  # over which white noise is as large
    velocity2, attitude2 = momentary.variances(nav.constants.momentary, now.vibration)
    tick = nav.history.ends_s[now.k], mean_s, now.vibration
    W = _swung(nav.constants.model, x, sensed, tick, more + 2.0 * attitude2 / mean_s**2, arm)
    W += velocity2 * np.eye(3)
    if about.missed.any():
        missed_i = rotation.quat_rotate(x[X_Q], rotation.cross(about.missed[:3] / about.dt_s, arm))
        W += np.outer(missed_i, missed_i)
    if not unknown_attitude.is_known(now.P):
        W += unknown_attitude.of_arm(now.P, rotation.cross(sensed[:3], arm)) * np.eye(3)
    return H[:, VEL] @ W @ H[:, VEL].T


def _unread(imu, rules):
    """Variances of the rate that gyros which cannot be read may have: (3,) rad^2/s^2; as `mean_rate.unread`.

    imu : ImuWindow;  rules : ImuRules
    """
    at_end = (np.abs(imu.dtheta_b) >= mean_rate.AT_END * rules.range[0] * imu.dt_s).any(axis=0)
    return np.where(imu.extra[0] > 0.0, np.where(at_end, rules.missed[0], rules.wrong[0]), 0.0) ** 2


@kernel
def _swung(model, x, sensed, tick, more, arm_b):
    """Covariance of the velocity of the antenna by what is not known of the motion of the IMU.

    model : `error_model.record`;  x : (X,) packed values;  sensed : (6,) corrected rate and specific force
    tick : its end, duration whose mean has the white noise of `sensed`, vibration
    more : (3,) rad^2/s^2, variances of the rate besides;  arm_b : (3,) m -> (3, 3) m^2/s^2, inertial axes
    """
    t_end_s, mean_s, vibration = tick
    row = model[error_model.valid(model, t_end_s)]
    rate2 = more + mean_rate.rate_noise(row, sensed[:3], sensed[3:], vibration, mean_s)
    arm_i = rotation.dcm_from_quat(x[X_Q]) @ rotation.skew(arm_b)
    return arm_i * rate2 @ arm_i.T
