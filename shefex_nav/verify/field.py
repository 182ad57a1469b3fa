"""The field of the Earth along a flight, beyond the model on board; and a world in which it is another one.

All seeds of a mission fly through the same field, so what the on-board model leaves out is the same three
numbers in all of them, slowly changing: however many seeds there are, it is drawn once. Statistics over seeds
that count it as drawn anew each time therefore need a world in which it is (`rotated`).
"""

import numpy as np

from shefex_nav.clock import IMU_HZ
from shefex_nav.environment import gravity
from shefex_nav.geometry import frames, rotation
from shefex_nav.scenario import surroundings
from shefex_nav.trajectory import placing

STEP = IMU_HZ  # samples between two evaluations of the field: a second, in which it changes by 0.1 micro gee


def beyond(field, trajectory, earth, begin=0):
    """What a field has beyond the on-board model, at every STEP-th sample of a flight.

    environment.gravity.GravityModel, Trajectory, EarthRotation, first sample -> (m,) s, (m, 3) m/s^2 in
    inertial axes
    """
    chosen = slice(begin, None, STEP)
    difference = []
    for t_s, r_i in zip(trajectory.t_s[chosen], trajectory.r_i[chosen], strict=True):
        C_ie = frames.dcm_ie(earth, t_s)
        r_e = C_ie.T @ r_i
        difference.append(C_ie @ (gravity.gravity_e(field, r_e) - gravity.gravity_j2_e(r_e)))
    return trajectory.t_s[chosen], np.array(difference)


def rotated(scenario, world, rng):
    """The same flight in a field whose difference from the on-board one points elsewhere.

    The difference keeps its size and how it changes along the flight; its direction is turned by a rotation
    drawn at random. The vehicle moves as before, so the accelerometers sense what gravity no longer does:
    f = a - g. (Thrust and drag may well differ by 20 micro gee.)

    Scenario, prepare.World, Generator -> prepare.World
    """
    trajectory = world.flight.trajectory
    field = surroundings.gravity(scenario)
    t_s, difference = beyond(field, trajectory, world.earth)
    more = difference @ (rotation.dcm_from_quat(_any_rotation(rng)) - np.eye(3)).T
    dv_b = world.imu.dv_b.copy()
    dt_s = np.diff(trajectory.t_s)
    C_ib = placing.of_quaternions(trajectory.q_ib[1:])
    for k in range(3):
        column = np.interp(0.5 * (trajectory.t_s[1:] + trajectory.t_s[:-1]), t_s, more[:, k])
        dv_b[1:] -= (column * dt_s)[:, None] * C_ib[:, k]
    return world._replace(imu=world.imu._replace(dv_b=dv_b))


def _any_rotation(rng):
    """A quaternion (4,), evenly distributed."""
    q = rng.standard_normal(4)
    return q / np.linalg.norm(q)
