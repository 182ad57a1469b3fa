"""Whether the filter can be run again over what a log has: looked at before it starts.

It needs an alignment, and every IMU block from there to the end: each begins where the one before it ends. A
log that somebody has changed may hold blocks that do not, readings of no sensor and an alignment elsewhere
than the vehicle was; what the filter would say of them looks like a result.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.log.topics import LogError, of_record
from shefex_nav.records import Alignment, GpsFix, ImuBlock
from shefex_nav.replay.dataset import PULLS, TURNS

SIGMAS = 10.0  # [E] by which the alignment may be off
SLACK_R, SLACK_V = 1e5, 1e3  # [E] m, m/s, beyond them: where sigmas are told too small
SAME = 1e-6  # rounding of covariances
NEAR_S = 1.0  # of the truth that an alignment is compared with
LARGEST = {  # [E] of an alignment; beyond them nothing is known of a flight, and covariances overflow
    "r_i": (1e9, "m"),
    "v_i": (1e6, "m/s"),
    "sigma_r": (1e9, "m"),
    "sigma_v": (1e6, "m/s"),
    "omega_i": (TURNS, "rad/s"),
    "gyro_bias": (TURNS, "rad/s"),
    "sigma_gyro_bias": (TURNS, "rad/s"),
}


def check(path, data):
    """LogError unless the filter can be run again over a RunData. path : of its log, for messages"""
    if data.alignment is None:
        raise _cannot(path, "it has no alignment to start from")
    if not len(data.imu.t_valid_s):
        raise _cannot(path, "it has no IMU samples; give the log of the flight itself")
    begin_s = np.concatenate([[data.alignment.t_valid_s], data.imu.t_valid_s[:-1]])
    _whole(path, data.imu, begin_s)
    _follow(path, data.imu, begin_s)
    _sensed(path, data.imu)
    _known(path, data.alignment)
    _placed(path, data)
    _alike(path, data.gps)


def _cannot(path, words):
    return LogError(f"{path}: cannot be run again: {words}")


def _whole(path, imu, begin_s):
    """LogError of IMU blocks that are missing. begin_s : (N,) ends of the blocks before, or the alignment"""
    length_s = imu.dt_s[0] * imu.dtheta_b.shape[1]
    step_s = imu.t_valid_s - begin_s
    gaps = np.flatnonzero(step_s > 1.5 * length_s)
    if not len(gaps):
        return
    if (usual_s := np.median(step_s)) > 1.5 * length_s:
        words = f"{1.0 / usual_s:.0f} IMU blocks a second of the {1.0 / length_s:.0f} that were measured"
        raise _cannot(path, f"it has {words}; fly with --set log.rate='100 Hz'")
    missed = f"T{begin_s[gaps[0]]:+.2f} s to T{imu.t_valid_s[gaps[0]]:+.2f} s"
    raise _cannot(path, f"IMU samples are missing from {missed}")


def _follow(path, imu, begin_s):
    """LogError of a block that does not begin where the one before it, or the alignment, is."""
    n = imu.dtheta_b.shape[1]
    apart = np.abs(imu.t_valid_s - begin_s - n * imu.dt_s) > SAME_S
    if not apart.any():
        return
    k = int(apart.argmax())
    end_s, length_s, imu_topic = imu.t_valid_s[k], n * imu.dt_s[k], of_record(ImuBlock).topic
    samples = f"{n} samples of {imu.dt_s[k]:.10g} s"
    if k == 0:
        place = f"{of_record(Alignment).topic}: t_valid_s: got {begin_s[0]:.10g}"
        words = f"where the {samples} of {imu_topic}, message 1, begin, which end at {end_s:.10g}"
        raise LogError(f"{path}: {place}, expected {end_s - length_s:.10g}, {words}")
    words = f"got {end_s:.10g}, expected {begin_s[k] + length_s:.10g}"
    follow = f"its {samples} (dt_s) follow on {begin_s[k]:.10g}"
    raise LogError(f"{path}: {imu_topic}: message {k + 1}: t_valid_s: {words}: {follow}")


def _sensed(path, imu):
    """LogError of increments that no sensor measures."""
    for name, most, unit in (("dtheta_b", TURNS, "rad/s"), ("dv_b", PULLS, "m/s^2")):
        size = np.abs(getattr(imu, name)).max(axis=(1, 2)) / imu.dt_s
        bad = (size > most) & imu.valid
        if bad.any():
            k = int(bad.argmax())
            words = f"got {size[k]:.4g} {unit} over {imu.dt_s[k]:.4g} s, expected {most:g} {unit} at most"
            raise LogError(f"{path}: {of_record(ImuBlock).topic}: message {k + 1}: {name}: {words}")


def _known(path, told):
    """LogError of an alignment whose numbers are too large to begin with, or none."""
    for name, (most, unit) in LARGEST.items():
        size = float(np.linalg.norm(getattr(told, name)))
        if not size <= most:
            words = f"got {size:.4g} {unit}, expected {most:g} {unit} at most"
            raise LogError(f"{path}: {of_record(Alignment).topic}: {name}: {words}")
    if len(P := told.P_with_biases) and not _goes_with(P, told.P_theta_b):
        words = "expected a covariance, 9 x 9, that begins with that of the attitude"
        raise LogError(f"{path}: {of_record(Alignment).topic}: P_with_biases: {words}")


def _goes_with(P, P_theta_b):
    """Whether a matrix of an alignment is a covariance, of the same attitude. (n, 9), (3, 3)"""
    if P.shape != (9, 9) or not np.allclose(P[:3, :3], P_theta_b, rtol=SAME, atol=0.0):
        return False
    sigma = np.sqrt(np.maximum(np.diag(P), 0.0))
    sigma[sigma == 0.0] = 1.0  # then the row is zero
    correlations = P / np.outer(sigma, sigma)
    return bool(np.allclose(P, P.T) and np.linalg.eigvalsh(correlations)[0] > -SAME)


def _placed(path, data):
    """LogError of an alignment that is far from the truth, where the log has it."""
    told, truth = data.alignment, data.truth
    apart_s = np.abs(truth.t_s - told.t_valid_s)
    if apart_s.min(initial=np.inf) > NEAR_S:
        return
    k = int(apart_s.argmin())
    sigma_v = told.sigma_v + float(np.linalg.norm(told.omega_i)) * told.sigma_r
    for name, most, unit in (
        ("r_i", SIGMAS * told.sigma_r + SLACK_R, "m"),
        ("v_i", SIGMAS * sigma_v + SLACK_V, "m/s"),
    ):
        off = float(np.linalg.norm(getattr(told, name) - getattr(truth, name)[k]))
        if off > most:
            words = f"is {off:.4g} {unit} from the truth at T{truth.t_s[k]:+.2f} s"
            place = f"{path}: {of_record(Alignment).topic}: {name}"
            raise LogError(f"{place}: {words}, expected {most:.4g} {unit} at most")


def _alike(path, fixes):
    """LogError of fixes of which some have a height and some have none: one receiver gives one kind."""
    kinds = [fix.horizontal for fix in fixes if fix.valid]
    if len(set(kinds)) > 1:
        k = [fix.valid and fix.horizontal != kinds[0] for fix in fixes].index(True)
        words = f"got {bool(fixes[k].horizontal)}, expected {bool(kinds[0])} as of the fixes before"
        raise LogError(f"{path}: {of_record(GpsFix).topic}: message {k + 1}: horizontal: {words}")
