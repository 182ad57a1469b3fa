"""What a magnetometer says about the errors: the Earth's field in body axes, three rows, or heading, one.

z = H dx + noise, as in `measurements`. With the World Magnetic Model's field B at the estimated place::

    B_m = C_bi B_i + h + noise,   C_bi(true) B = B_b + B_b x dtheta_b,

h the hard iron (block `hard_iron`). How the field changes with the place, 2e-11 T in a metre, is left out.
The heading is the part of z athwart the horizontal field, in radians: z_heading = e . z with

    e = (d x B)/|B_h|^2,   d down, B_h the horizontal part (Groves, 2nd ed., section 6.1.1)

so that what tilts the level tilts the heading by the inclination, as it does a compass. What is no state
lasts: soft iron and the field that no model has. A reading is judged by the gate with all of it, and counts
less behind others, as one of the barometer does (`measure_barometer`).
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.environment import magnetic_field
from shefex_nav.geometry import frames, rotation, wgs84
from shefex_nav.onboard.navigation.measurements import lasting_factor
from shefex_nav.onboard.navigation.state import ATT, X_HARD_IRON, X_Q, X_R

SIGMAS = 3.0  # of the noise, within which two readings agree
NO_HEADING = 10.0  # [E] sigmas of the model by which the horizontal field must exceed it for a heading


class MagnetometerModel(NamedTuple):
    """What the filter assumes of a magnetometer; sigmas are standard deviations."""

    harmonics: tuple  # of `magnetic_field.load`
    sigma_n: np.ndarray  # (3,) T, of the model, north, east and down
    noise: float  # T, each axis, white, quanta included
    soft_iron: float  # of the field
    memory_s: float  # for how long soft iron and the error of the model keep their sign
    heading: bool  # one row, the heading, in place of three
    release: tuple  # rejections, s, after which readings are a new hard iron


class Field(NamedTuple):
    """The field where the vehicle is."""

    b_b: np.ndarray  # (3,) T, body axes
    C_bn: np.ndarray  # (3, 3)
    horizontal: float  # T


class Offset(NamedTuple):
    """A reading against the filter, for the comparison with the next."""

    t_valid_s: float
    z: np.ndarray
    noise: float


def field(nav, t_s, x):
    """Field of packed values x at a mission time, by the filter's model."""
    C_ie = frames.dcm_ie(nav.earth, t_s)
    r_e, C_bi = C_ie.T @ x[X_R], rotation.dcm_from_quat(x[X_Q]).T
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e)
    C_en = wgs84.dcm_en(latitude, longitude)
    b_e, C_bn = magnetic_field.field_e(nav.params.magnetometer.harmonics, r_e), C_bi @ C_ie @ C_en
    b_n = C_en.T @ b_e
    return Field(C_bn @ b_n, C_bn, float(np.hypot(b_n[0], b_n[1])))


def linearise(nav, now, fix):
    """As `sensors.Linearise`: z in T, or in rad of a heading."""
    return reading(nav, now.t_s, now.x, fix)


def reading(nav, t_s, x, fix):
    """One reading.

    nav : fusion.Filter, of which params, layout and earth are used;  t_s, x : at the instant of the reading
    fix : MagnetometerReading -> z (3,), H (3, n), R (3, 3) T^2; with `heading` one row, rad
    """
    model, here, H = nav.params.magnetometer, field(nav, t_s, x), np.zeros((3, nav.layout.n))
    z = fix.field_b - x[X_HARD_IRON] - here.b_b
    H[:, ATT] = rotation.skew(here.b_b)
    H[:, nav.layout.places["hard_iron"]] = np.eye(3)
    return _as_told(model, here, z, H, model.noise**2 * np.eye(3) + lasting(model, here))


def lasting(model, here):
    """Covariance of errors that are no states: (3, 3) T^2, body axes."""
    of_model = here.C_bn @ np.diag(model.sigma_n**2) @ here.C_bn.T
    return of_model + (model.soft_iron**2 * float(here.b_b @ here.b_b)) * np.eye(3)


def _as_told(model, here, z, H, R):
    """The three rows, or their part that is a heading."""
    if not model.heading:
        return z, H, R
    e = np.cross(here.C_bn[:, 2], here.b_b) / here.horizontal**2
    return np.array([e @ z]), (e @ H)[None], np.array([[e @ R @ e]])


def counts(nav, fix, R, gap_s):
    """R with which a reading that has passed the gate corrects the state. gap_s : since the one before it"""
    model, here = nav.params.magnetometer, field(nav, fix.t_valid_s, nav.history.x)
    factor = lasting_factor(1.0, model.memory_s, gap_s)
    whole = model.noise**2 * np.eye(3) + factor * lasting(model, here)
    return _as_told(model, here, np.zeros(3), np.zeros((3, nav.layout.n)), whole)[2]


def unfit(nav, t_s, x, fix):
    """Why a reading is not to be used at packed values x; '' if it may. fusion.Filter, s -> str"""
    if fix.at_limit:
        return "not used: the sensor is at an end of its range"
    model = nav.params.magnetometer
    if model.heading and field(nav, t_s, x).horizontal < NO_HEADING * model.sigma_n.max():
        return "not used: the horizontal field is too weak for a heading"
    return ""


def offsets_agree(earlier, later):
    """Whether two rejected readings, Offset each, are off by the same field, which a new hard iron is."""
    apart = np.abs(later.z - earlier.z).max()
    return 0.0 < later.t_valid_s - earlier.t_valid_s and bool(apart <= SIGMAS * np.sqrt(2.0) * later.noise)
