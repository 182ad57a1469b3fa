"""A body without an attitude falls to the ground: its mass and drag, gravitation, air and wind.

In: a `Body`, its place and velocity, the `surroundings.World`. Out: where it meets the ground, and its path.
The equations of motion are those of the vehicle, of which the body is one whose drag depends on nothing but
the Mach number and acts at its centre of mass.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry import frames
from shefex_nav.world.flight import attitude_program, control, devices, dynamics, surroundings, vehicle
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight.aerodynamics import tables
from shefex_nav.world.flight.integrate import EVENT, STOP, TOLERANCE, Samples, Vehicle, integrate

PATH_S = 1.0  # s between points of a path
NEVER_DOWN_S = 12 * 3600.0  # s


class Body(NamedTuple):
    """A body that falls."""

    mass: float  # kg
    drag: p.Spent | None  # None: no drag, as in a vacuum


class Fall(NamedTuple):
    """A fall to the ground; path: n instants, frame i, the last one on the ground."""

    t_s: np.ndarray  # (n,)
    r_i: np.ndarray  # (n, 3) m
    v_i: np.ndarray  # (n, 3) m/s

    @property
    def landing(self):
        """(time s, place (3,) m, velocity (3,) m/s), frame i."""
        return float(self.t_s[-1]), self.r_i[-1], self.v_i[-1]


def fall(world, body, t_s, r_i, v_i, *, ground=0.0, tolerance=TOLERANCE):
    """Fall of a body from a state until it comes down through a height.

    Parameters
    ----------
    world : surroundings.World
    t_s, r_i, v_i : s, (3,) m, (3,) m/s, frame i, of its centre of mass
    ground : m above the ellipsoid; below zero it is reached along the last velocity
    tolerance : as of `integrate`

    Returns
    -------
    Fall, or None if the body is below the ground at first, or does not come down within twelve hours
    """
    x = np.zeros(dynamics.STATE)
    x[0:3], x[3:6], x[6] = r_i, v_i, 1.0
    begin = surroundings.height(world.shape, frames.dcm_ie(world.earth, t_s).T @ np.asarray(r_i, dtype=float))
    if begin <= max(ground, 0.0):
        return None
    still = attitude_program.hold(0.0, 1.0, 0.0)
    steering = control.none()._replace(stop_height=max(float(ground), 0.0))
    flown = Vehicle(_configuration(body), dynamics.FREE, still, steering)
    rows, k, times, states = np.zeros((2000, dynamics.ROW)), 0, [], []
    event, now = None, float(t_s)
    while event not in (EVENT, STOP):
        if now - t_s > NEVER_DOWN_S:
            return None
        end, begin_s = now + PATH_S * (len(rows) - 1), now
        now, k, event = integrate(x, now, end, 0, Samples(now, PATH_S, rows), flown, world, tolerance)
        times.append(begin_s + PATH_S * np.arange(k))
        states.append(rows[:k, :6].copy())
    times.append([now])
    states.append(x[None, :6].copy())
    states = np.concatenate(states)
    found = Fall(np.concatenate(times), states[:, :3], states[:, 3:])
    return found if ground >= 0.0 else _lower(world, found, ground)


def _lower(world, found, ground):
    """A Fall that goes on along its last velocity to a ground below the ellipsoid."""
    t_s, r_i, v_i = found.landing
    r_e, v_e = frames.ecef_from_inertial(world.earth, t_s, r_i, v_i)
    since = along(world.shape, r_e, v_e, ground)
    turned, _ = frames.inertial_from_ecef(world.earth, t_s + since, r_e + since * v_e, v_e)
    found.t_s[-1], found.r_i[-1] = t_s + since, turned
    return found


def along(shape, r_e, v_e, ground):
    """Time [s] until a height [m] is reached along a straight line; Newton's method. (3,) m, (3,) m/s"""
    since = 0.0
    for _ in range(20):
        here = surroundings.height(shape, r_e + since * v_e)
        rate = surroundings.height(shape, r_e + (since + 1e-3) * v_e) - here
        step = (ground - here) / (1e3 * rate)
        since += step
        if abs(step) < 1e-9:
            break
    return since


def _configuration(body):
    """vehicle.Configuration of a Body: IMU, centre of mass and centre of pressure are one point."""
    drag = body.drag or p.Spent(1.0, np.array([0.0, 1.0]), np.zeros(2))
    none = np.zeros_like(drag.drag)
    aero = p.Aerodynamics(
        area_m2=drag.area_m2, diameter_m=1.0, fin_cant=0.0, mach=drag.mach, alpha=np.zeros(1), axial=none,
        normal_slope=none, pressure_station_m=none, drag=drag.drag, pitch_damping=none, roll_damping=none,
        roll_by_cant=none,
    )  # fmt: skip
    row = [body.mass, 0.0, 1.0, 1.0, 1.0]
    return vehicle.Configuration(
        mass=np.array([[0.0, *row], [1.0, *row]]),
        products=np.zeros(3),
        offset=np.zeros(2),
        imu=np.zeros(3),
        aero=tables(aero),
        spin_motors=devices.spin_motor_rows(None),
        yo_yo=devices.yo_yo_row(None, 0.0, 1.0),
        parachute=devices.parachute_row(None),
        **vehicle.no_motor(),
    )
