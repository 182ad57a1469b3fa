"""Bodies, Earths and sections of flight for tests of the equations of motion, without a mission around."""

import numpy as np
from shefex2 import PARAMS, STACK, part, payload

from shefex_nav.environment import gravity
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.world.flight import attitude_program, control, dynamics, integrate, surroundings, vehicle
from shefex_nav.world.flight.params import Air

STILL = EarthRotation(np.eye(3), np.eye(3), 0.0, 0.0)
TURNING = EarthRotation(np.eye(3), np.eye(3), 0.4, wgs84.OMEGA)
POINT = gravity.load("point")
NONE = gravity.from_normalised(0.0, 6.4e6, np.ones((1, 1)), np.zeros((1, 1)))
RAIL = surroundings.Rail(np.zeros(3), np.array([1.0, 0.0, 0.0]), 1e9)
VACUUM = Air(np.zeros((0, 4)), 0.0)
STANDARD = Air(np.zeros((0, 4)), 1.0)
CALM = np.zeros((0, 3))
FAR = np.array([2.0e7, 0.0, 0.0])  # m, where nothing is below
BODY = part(500.0, 3.0, 60.0, 900.0)
IMU = np.array([-2.0, 0.1, -0.05])
AT_CG = np.array([-BODY.station, 0.0, 0.0])  # the centre of mass of BODY
IDLE = attitude_program.hold(0.0, 1.0, 0.0)


def world(field=NONE, earth=STILL, air=VACUUM, wind=CALM, rail=RAIL):
    return surroundings.surround(field, earth, rail, air, wind)


def body(parts=(BODY,), stage=None, imu=IMU, aerodynamics=STACK, **options):
    """Configuration of rigid parts; options: offset, tilt of the whole, or fields to replace."""
    asymmetry = {name: options.pop(name, (0.0, 0.0)) for name in ("offset", "tilt")}
    params = PARAMS._replace(imu_b=imu, payload=payload(1.0, 1.0, 1.0, 1.0, **asymmetry))
    return vehicle.configure(parts, stage, params, aerodynamics)._replace(**options)


def state(r_i=FAR, v_i=(0.0, 0.0, 0.0), omega_b=(0.0, 0.0, 0.0), q_ib=(1.0, 0.0, 0.0, 0.0)):
    return np.concatenate([r_i, v_i, q_ib, omega_b, np.zeros(6)]).astype(float)


def section(x, t_s, t_end, configuration, around, **options):
    """Integrate a copy of x: (state, time, how it ended, rows at dt). dt: 0.1 s unless given."""
    dt = options.get("dt", 0.1)
    rows = np.full((int((t_end - t_s) / dt + 1e-6) + 1, dynamics.ROW), np.nan)
    x = x.copy()
    mode, law = options.get("mode", dynamics.FREE), options.get("law", IDLE)
    steering, tolerance = (
        options.get("steering", control.none()),
        options.get("tolerance", integrate.TOLERANCE),
    )
    samples = integrate.Samples(t_s, dt, rows)
    flown = integrate.Vehicle(configuration, mode, law, steering)
    t, k, how = integrate.integrate(x, t_s, t_end, 0, samples, flown, around, tolerance)
    return x, t, how, rows[:k]


def propagate(x, t_end, configuration, around=None, **options):
    """State at t_end and the rows before it, of a section that begins at 0 and lasts."""
    x, t, how, rows = section(x, 0.0, float(t_end), configuration, around or world(), **options)
    assert (t, how) == (t_end, integrate.T_END)
    return x, rows
