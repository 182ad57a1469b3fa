"""The attitude programme: what the body rate is while a task is flown.

In: a task of the mission's programme and the attitude from which it starts. Out: a `RateLaw`, and from it the
body rate and its derivative at any time. Flown with a prescribed attitude the body follows the law itself;
else the law moves the attitude that the cold-gas system follows.

Every rate is a function of time alone with a continuous derivative, and begins and ends with nothing but the
spin. A target direction is given as azimuth and elevation in the local level frame below the place where the
vehicle will be at the instant for which the direction is meant; that place is predicted by a free fall.
"""

import math
from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.world.flight import tasks


class RateLaw(NamedTuple):
    """Body rate during [t_0, t_1]: a spin about x, a turn about an axis that does not spin, small motions.

    omega = p(t) e_x + dpsi/dt R_x(-phi) axis + (1 - S) R_x(nutation (t - t_0)) transverse
            + fade(t) (steady + swing (cos(w t') a + sin(w t') b))
    with p from spin_0 to spin_1 and psi from 0 to angle along the smooth step S, dphi/dt = p.
    """

    t_0: float
    t_1: float
    spin_0: float  # rad/s
    spin_1: float  # rad/s
    axis: np.ndarray  # (3,) unit, body axes at t_0
    angle: float  # rad
    transverse: np.ndarray  # (3,) rad/s at t_0, y and z
    nutation: float  # rad/s, turning of the transverse rate in the body
    steady: np.ndarray  # (3,) rad/s
    swing: np.ndarray  # (2, 3) rad/s, body components at phase 0 and a quarter period later
    frequency: float  # rad/s
    phase: float  # rad
    ramp: float  # s, of the fade; 0: without the small motions


@inner(forceinline=True)
def smooth_step(u):
    """S(u) = 10 u^3 - 15 u^4 + 6 u^5 from 0 to 1, its two derivatives and its integral from 0."""
    u = min(1.0, max(0.0, u))
    s = u**3 * (10.0 - 15.0 * u + 6.0 * u * u)
    ds = 30.0 * u**2 * (1.0 - u) ** 2
    return s, ds, 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u), u**4 * (2.5 - 3.0 * u + u * u)


@inner(forceinline=True)
def _residual_rate(law, t_s):
    """The small motions of a `RateLaw` and their derivative: six numbers."""
    if law.ramp == 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    tau = t_s - law.t_0
    rise, drise, _, _ = smooth_step(tau / law.ramp)
    fall, dfall, _, _ = smooth_step((law.t_1 - t_s) / law.ramp)
    fade, dfade = rise * fall, (drise * fall - rise * dfall) / law.ramp
    c, s = np.cos(law.frequency * tau + law.phase), np.sin(law.frequency * tau + law.phase)
    a, b = law.swing[0], law.swing[1]
    x, y = law.steady[0] + c * a[0] + s * b[0], law.steady[1] + c * a[1] + s * b[1]
    z = law.steady[2] + c * a[2] + s * b[2]
    w = fade * law.frequency
    return (
        fade * x,
        fade * y,
        fade * z,
        dfade * x + w * (c * b[0] - s * a[0]),
        dfade * y + w * (c * b[1] - s * a[1]),
        dfade * z + w * (c * b[2] - s * a[2]),
    )


@kernel(forceinline=True)
def body_rate(law, t_s):
    """omega_ib_b of a `RateLaw` and its derivative at t_s within the piece: six numbers, rad/s, rad/s^2."""
    width = law.t_1 - law.t_0
    tau = t_s - law.t_0
    s, ds, dds, integral = smooth_step(tau / width)
    change = law.spin_1 - law.spin_0
    p, dp = law.spin_0 + change * s, change * ds / width
    phi = law.spin_0 * tau + change * integral * width
    w, dw = law.angle * ds / width, law.angle * dds / width**2
    # the axis keeps its direction in space while the body spins under it
    c, sn = np.cos(phi), np.sin(phi)
    ax, ay, az = law.axis[0], c * law.axis[1] + sn * law.axis[2], c * law.axis[2] - sn * law.axis[1]
    # transverse rate at the start, nutating and damped
    c, sn = np.cos(law.nutation * tau), np.sin(law.nutation * tau)
    ty, tz = c * law.transverse[1] - sn * law.transverse[2], sn * law.transverse[1] + c * law.transverse[2]
    left, dleft = 1.0 - s, -ds / width
    x, y, z, dx, dy, dz = _residual_rate(law, t_s)
    return (
        x + p + w * ax,
        y + w * ay + left * ty,
        z + w * az + left * tz,
        dx + dp + dw * ax,
        dy + dw * ay + w * p * az + dleft * ty - left * law.nutation * tz,
        dz + dw * az - w * p * ay + dleft * tz + left * law.nutation * ty,
    )


def hold(t_0, t_1, spin):
    """Spin at a constant rate about x and do nothing else."""
    still, none = (float(t_0), float(t_1), float(spin), float(spin)), np.zeros(3)
    return RateLaw(*still, none, 0.0, none, 0.0, none, np.zeros((2, 3)), 0.0, 0.0, 0.0)


def damp(t_0, t_1, omega_b, nutation):
    """Keep the spin, let the transverse rate at t_0 go to zero while it nutates freely."""
    law = hold(t_0, t_1, omega_b[0])
    return law._replace(transverse=np.array([0.0, omega_b[1], omega_b[2]]), nutation=float(nutation))


def ramp_spin(t_0, t_1, spin_0, spin_1):
    """Change of the spin about x."""
    return hold(t_0, t_1, spin_0)._replace(spin_1=float(spin_1))


def turn_roll_axis(t_0, t_1, spin, q_ib, direction_i):
    """Turn the roll axis along a great circle to a direction while spinning. (4,), (3,) unit -> RateLaw."""
    target_b = rotation.quat_rotate(rotation.quat_conjugate(q_ib), direction_i)
    axis = np.array([0.0, -target_b[2], target_b[1]])  # e_x x target
    across = np.sqrt((axis**2).sum())
    axis = axis / across if across > 1e-12 else np.array([0.0, 0.0, 1.0])
    return hold(t_0, t_1, spin)._replace(axis=axis, angle=math.atan2(across, target_b[0]))


def turn_to(t_0, t_1, q_ib, q_target):
    """Turn about the one axis that leads from one attitude to the other the shorter way; no spin."""
    phi = rotation.rotvec_from_quat(rotation.quat_multiply(rotation.quat_conjugate(q_ib), q_target))
    angle = float(np.sqrt((phi**2).sum()))
    axis = phi / angle if angle > 1e-12 else np.array([1.0, 0.0, 0.0])
    return hold(t_0, t_1, 0.0)._replace(axis=axis, angle=angle)


def point(task, q_ib, boresight_i, C_bc):
    """Turn the star camera's boresight to a direction, and the camera about it to `task.roll`."""
    roll_axis_i = rotation.quat_rotate(q_ib, np.array([1.0, 0.0, 0.0]))
    target = camera_attitude(boresight_i, roll_axis_i, task.roll, C_bc)
    return turn_to(task.start, task.end, q_ib, target)


def dwell(task, C_bc):
    """Hold the star camera's attitude, but for the rates asked for. C_bc: (3, 3) nominal mounting."""
    law = hold(task.start, task.end, 0.0)
    if not task.moves:
        return law
    return law._replace(
        steady=task.boresight_rate * np.ascontiguousarray(C_bc[:, 2]),
        swing=task.cross_rate * np.ascontiguousarray(C_bc[:, :2].T),
        frequency=2.0 * np.pi / float(task.cross_period or 1.0),
        phase=float(task.cross_phase),
        ramp=float(task.ramp),
    )


def turn_with_orbit(task, q_ib, ahead):
    """Turn about the normal of the orbit by its mean rate over a revolution, or a task that is shorter.

    The rate is that of the direction from the Earth's centre, as free fall predicts it: under J2 the mean
    motion of the osculating elements would run away from it, by up to a degree in each revolution.
    q_ib (4,) at the begin;  ahead as of `rate_law`
    """
    r_0, v_0 = ahead(task.start)
    a = 1.0 / (2.0 / np.sqrt(r_0 @ r_0) - (v_0 @ v_0) / wgs84.GM)
    mean_motion = np.sqrt(wgs84.GM / a**3)
    span = min(2.0 * np.pi / mean_motion, task.end - task.start)
    r_1, _ = ahead(task.start + span)
    normal_i = np.cross(r_0, v_0)
    normal_i /= np.sqrt(normal_i @ normal_i)
    angle = math.atan2(normal_i @ np.cross(r_0, r_1), r_0 @ r_1)
    angle += 2.0 * np.pi * round((mean_motion * span - angle) / (2.0 * np.pi))
    rate_b = rotation.quat_rotate(rotation.quat_conjugate(q_ib), angle / span * normal_i)
    return hold(task.start, task.end, 0.0)._replace(steady=rate_b, ramp=float(task.ramp))


def rate_law(task, q_ib, spin, ahead, earth, C_bc):
    """The law by which a task moves the attitude q_ib (4,) that it starts from, spinning at `spin` rad/s.

    ahead: function of the mission time s that predicts (r_i, v_i) of the free fall. Damping has no law of
    this kind: what it leaves depends on the rates it finds, see `damp`.
    """
    t_0, t_1 = task.start, task.end
    match task:
        case tasks.Turn():
            r_i, _ = ahead(task.level_at)
            target_i = direction_i(earth, task.level_at, r_i, task.azimuth, task.elevation)
            return turn_roll_axis(t_0, t_1, spin, q_ib, target_i)
        case tasks.AlignVelocity():
            r_i, v_i = ahead(task.at)
            v_air_i = v_i - np.cross(frames.omega_ie_i(earth), r_i)
            return turn_roll_axis(t_0, t_1, spin, q_ib, v_air_i / np.sqrt(v_air_i @ v_air_i))
        case tasks.SpinTo():
            return ramp_spin(t_0, t_1, spin, task.rate)
        case tasks.Point():
            r_i, _ = ahead(t_1)
            boresight_i = direction_i(earth, t_1, r_i, task.azimuth, task.elevation)
            return point(task, q_ib, boresight_i, C_bc)
        case tasks.PointInertial():
            return point(task, q_ib, sky_direction_i(task.right_ascension, task.declination), C_bc)
        case tasks.PointNadir():
            return turn_to(t_0, t_1, q_ib, nadir_attitude(*ahead(t_1)))
        case tasks.Dwell():
            return dwell(task, C_bc)
        case tasks.TurnWithOrbit():
            return turn_with_orbit(task, q_ib, ahead)
        case tasks.Hold():
            return hold(t_0, t_1, spin)
    raise TypeError(f"no law for {task!r}")


def direction_i(earth, t_s, r_i, azimuth, elevation):
    """Unit vector of an azimuth and elevation in the local level frame below r_i: (3,), frame i."""
    C_ie = frames.dcm_ie(earth, t_s)
    latitude, longitude, _ = wgs84.geodetic_from_ecef(C_ie.T @ r_i)
    u_n = np.array(
        [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), -np.sin(elevation)]
    )
    return C_ie @ wgs84.dcm_en(latitude, longitude) @ u_n


def sky_direction_i(right_ascension, declination):
    """Unit vector of a place in the sky: (3,), frame i."""
    across = np.cos(declination)
    return np.array([across * np.cos(right_ascension), across * np.sin(right_ascension), np.sin(declination)])


def camera_attitude(boresight_i, x_b_i, roll, C_bc):
    """q_ib that lays the boresight along boresight_i.

    At roll 0 the camera's x axis is as near as it gets to x_b_i; roll turns it about the boresight.
    (3,), (3,) unit vectors, rad, (3, 3) -> (4,).
    """
    across = x_b_i - (x_b_i @ boresight_i) * boresight_i
    norm = np.sqrt(across @ across)
    across = across / norm if norm > 1e-6 else wgs84.perpendicular(boresight_i)
    x_i = np.cos(roll) * across + np.sin(roll) * np.cross(boresight_i, across)
    C_ic = np.stack([x_i, np.cross(boresight_i, x_i), boresight_i], axis=1)
    return rotation.quat_from_dcm(C_ic @ C_bc.T)


def nadir_attitude(r_i, v_i):
    """q_ib (4,) with z to the Earth's centre and x along what v_i has across it. r_i, v_i (3,)."""
    down = -r_i / np.sqrt(r_i @ r_i)
    across = np.cross(down, v_i)
    across /= np.sqrt(across @ across)
    return rotation.quat_from_dcm(np.stack([np.cross(across, down), across, down], axis=1))
