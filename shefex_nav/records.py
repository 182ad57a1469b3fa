"""The data that flows: what passes between world, on-board computer, log and report.

Records are immutable tuples in SI units and radians; the last letter of a vector names its frame. What is
measured has `t_valid_s`, the instant that it measures, and `t_available_s`, when the computer has it.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from shefex_nav.fields import (
    EQUAL,
    Q_IB,
    T_AVAILABLE,
    T_S,
    T_VALID,
    flag,
    integer,
    matrix,
    member,
    number,
    text,
    vector,
)


class Phase(IntEnum):
    """Phase of the mission, as flown (truth)."""

    PAD = 0
    BOOST = 1  # a motor burns, on the rail and after
    COAST = 2  # no motor burns, nothing steers
    MANOEUVRE = 3  # the attitude control damps, turns or spins the vehicle
    POINTING = 4  # it holds an attitude or a direction
    DESCENT = 5  # free, past apogee, nothing left to do but land
    PARACHUTE = 6
    ORBIT = 7  # started in orbit and not steered
    GROUND = 8  # stands on the ground and never leaves it


class Trajectory(NamedTuple):
    """The truth at the IMU rate: arrays over N samples, sample k at t_s[k].

    The vehicle's reference point is the IMU (origin of b), not the centre of mass.
    """

    t_s: np.ndarray  # (N,) from lift-off, equally spaced
    phase: np.ndarray  # (N,) Phase as int8
    r_i: np.ndarray  # (N, 3) m
    v_i: np.ndarray  # (N, 3) m/s
    q_ib: np.ndarray  # (N, 4)
    omega_ib_b: np.ndarray  # (N, 3) rad/s
    f_b: np.ndarray  # (N, 3) m/s^2, specific force at the IMU
    dtheta_b: np.ndarray  # (N, 3) rad, integral of omega_ib_b over (t[k-1], t[k]]; row 0 is zero
    dv_b: np.ndarray  # (N, 3) m/s, integral of f_b likewise, in the turning body frame
    mass_kg: np.ndarray  # (N,)
    mach: np.ndarray  # (N,)
    dynamic_pressure_pa: np.ndarray  # (N,)
    thrust_n: np.ndarray  # (N,)
    burning: np.ndarray  # (N,) int8, stage whose motor burns, counted from 1; 0: none
    angle_of_attack: np.ndarray  # (N,) rad, total, between roll axis and air-relative velocity


class TruthSample(NamedTuple):
    """The truth at one tick of the on-board clock, for the log."""

    t_s: T_S
    phase: member(Phase, "phase of the mission")
    r_i: vector("m", "position of the IMU, inertial axes")
    v_i: vector("m/s", "velocity, inertial axes")
    q_ib: Q_IB
    omega_ib_b: vector("rad/s", "rate of b against i, body axes")
    f_b: vector("m/s^2", "specific force at the IMU, body axes")
    angle_of_attack: number("rad", "total, roll axis against the air")


class ControlSample(NamedTuple):
    """The attitude control as flown (truth) at one instant, for the log."""

    t_s: T_S
    pointing_error: vector("rad", "true against wanted attitude, body axes; NaN about axes left alone")
    torque_b: vector("N m", "torque of the valves, body axes")
    propellant_kg: number("kg", "gas used since the start")


class Event(NamedTuple):
    """Something that happened in the mission."""

    t_s: T_S
    name: text("what")  # lower case with underscores: lift_off, burn_out_1, apogee, entry, impact ...
    altitude_m: number("m", "above the ellipsoid")
    detail: text("for people; may be empty")


class Alignment(NamedTuple):
    """Where the launch crew says the vehicle stands before lift-off; starts the navigation."""

    t_valid_s: T_VALID
    r_i: vector("m", "position of the IMU, inertial axes")
    v_i: vector("m/s", "velocity, inertial axes")
    q_ib: Q_IB
    sigma_r: number("m", "standard deviation of each axis")
    sigma_v: number("m/s", "standard deviation of each axis")
    P_theta_b: matrix("rad^2", "covariance of the attitude error, body axes")
    gyro_bias: number("rad/s", "gyro bias found while aligning, if any", (-1,)) = np.empty(0)
    sigma_gyro_bias: number("rad/s", "its standard deviation, each axis") = 0.0
    P_with_biases: number("", "covariance: attitude, gyros, accelerometers", (-1, 9)) = np.empty((0, 9))
    omega_i: vector("rad/s", "rate of the axes against which sigma_v counts, as of the Earth") = np.zeros(3)


class ImuBlock(NamedTuple):
    """The IMU samples of one tick, oldest first, the last ends at the tick: four at 400 Hz and 100 Hz."""

    t_valid_s: number("s", "mission time at the end of the last sample")
    t_available_s: T_AVAILABLE
    dt_s: number("s", "duration of one sample")
    dtheta_b: number("rad", "integrated rate, body axes, n x 3, oldest sample first", (EQUAL, 3))
    dv_b: number("m/s", "integrated specific force, body axes, likewise", (EQUAL, 3))
    saturated: flag("a sample reached the range of its sensor")
    valid: flag("false: the unit did not answer, the samples are NaN") = True


class GpsFix(NamedTuple):
    """Position and velocity of the GPS antenna a; valid is False while there is no solution."""

    t_valid_s: T_VALID
    t_available_s: T_AVAILABLE
    valid: flag("false while there is no solution")
    r_ea_e: vector("m", "position, Earth-fixed axes")
    v_ea_e: vector("m/s", "velocity relative to the Earth, Earth-fixed axes; NaN: none is given")
    R_r_e: matrix("m^2", "covariance as the receiver reports it")
    R_v_e: matrix("m^2/s^2", "covariance of the velocity")
    n_satellites: integer("satellites used; below zero: not said")
    pdop: number("", "dilution of precision, position")
    reason: text("why there is no fix; empty when valid")
    # latitude and longitude alone: r_ea_e lies at any height above the place or below it, R_r_e has no part
    # along the vertical there, and of the velocity nothing is known
    horizontal: flag("latitude and longitude alone: the height of r_ea_e means nothing") = False


class GpsRanges(NamedTuple):
    """What the receiver's channels measure at one instant; n satellites are tracked, and there may be none.

    A pseudorange is the distance from the satellite at transmission to the antenna at t_valid_s, plus the
    bias of the receiver's clock; what is broadcast about the satellite's clock and the ionosphere, and a
    model of the troposphere, have been taken out. A range rate is its change in time, likewise.
    """

    t_valid_s: T_VALID
    t_available_s: T_AVAILABLE
    prn: integer("ascending, of an almanac, or slots 1 to 24 of the nominal constellation", (-1,))
    pseudorange: number("m", "with the bias of the receiver's clock", (-1,))
    range_rate: number("m/s", "with the drift of the receiver's clock, positive as the distance grows", (-1,))
    r_es_e: number("m", "satellite at transmission, Earth-fixed axes of t_valid_s, n x 3 row by row", (-1, 3))
    v_es_e: number("m/s", "velocity relative to these axes, which turn with the Earth, n x 3", (-1, 3))
    sigma_range: number("m", "noise of the pseudorange as reported, standard deviation; white in time", (-1,))
    sigma_range_rate: number("m/s", "noise of the range rate", (-1,))
    reason: text("why no satellite is tracked") = ""
    sigma_lasting: number("m", "1 sigma of errors that last, its own; empty: not told", (-1,)) = np.empty(0)
    sigma_shared: number("m", "likewise, of what one error of all does to each", (-1,)) = np.empty(0)


class CameraCommand(NamedTuple):
    """What the star tracker asks of the camera for the next frame."""

    t_s: T_S
    exposure_s: number("s", "")
    gain_db: number("dB", "")


class Frame(NamedTuple):
    """One picture of the star camera."""

    number: integer("of the frame")
    t_start_s: number("s", "mission time at which the shutter opens, over the first row")
    t_valid_s: T_VALID  # middle of the exposure of the middle row
    t_available_s: T_AVAILABLE  # read out and in the computer's memory
    exposure_s: number("s", "")  # of every row
    gain_db: number("dB", "")
    image_dn: np.ndarray  # (rows, columns) uint8, or uint16 of a detector with more bits
    line_s: number("s", "from the start of one row to that of the next, 0 = global shutter") = 0.0
    bits: integer("of a grey value, which is at most 2^bits - 1") = 8


class FrameTruth(NamedTuple):
    """What the camera really looked at, for scoring and the log; never seen on board."""

    number: integer("of the frame")
    t_valid_s: T_VALID
    q_ic: vector("", "true attitude, camera to inertial axes, mounting error included", 4, name="q_ic_wxyz")
    rate: number("rad/s", "largest body rate during the exposure")
    sun_angle: number("rad", "boresight to the Sun")
    limb_angle: number("rad", "boresight to the Earth's limb, positive above")
    exclusion_met: flag("both angles outside their exclusion; a hidden Sun does not count")
    hip: integer("Hipparcos numbers of the brightest stars on the detector", (-1,))
    xy_px: number("px", "where they are at t_valid_s, x and y in turn", (-1, 2))
    sun_hidden: flag("the Earth hides the Sun") = False


class Reason(IntEnum):
    """Why a frame gave no attitude; NONE when it did."""

    NONE = 0
    TOO_FEW_STARS = 1
    NO_MATCH = 2
    AMBIGUOUS = 3  # more than one identification fits
    RESIDUALS = 4  # the identified stars do not fit one attitude
    SATURATED = 5  # mean grey value above its reference
    SMEARED = 6  # the rate was too high for the exposure
    SUN_EXCLUSION = 7
    EARTH_EXCLUSION = 8


class Scan(IntEnum):
    """How the objects of a frame were searched."""

    UNKNOWN = 0  # a log that does not say
    SEQUENTIAL = 1  # in one pass, as spots
    MAXIMUM = 2  # the brightest place again and again, as spots
    STREAKS = 3  # in the whole frame, along the streaks that the rate of the camera makes
    STREAKS_NEAR = 4  # likewise, around the places where stars are predicted
    RUN_LENGTH = 5  # clusters of this frame and the one before
    OTHER = 6  # as spots, by a method of a plug-in


class Detections(NamedTuple):
    """Objects found in one frame, brightest first."""

    xy_px: number("px", "centroids at t_valid_s, x and y in turn", (-1, 2))
    flux_dn: number("", "grey values above the background, summed", (-1,))
    n_pixels: integer("pixels of each detection, above the growth threshold", (-1,))
    n_saturated: integer("saturated pixels of each detection", (-1,))
    P_px: number("px^2", "covariance of each centroid, of the noise alone", (-1, 2, 2), name="P_px2")


class StarVectors(NamedTuple):
    """Stars of one frame that may be used each by itself, m of them; their directions need no corrections.

    The stars that made the attitude, without those that did not fit; in a frame without attitude the one or
    two that a prediction leaves no doubt about, if the navigation asks for them.
    """

    hip: integer("Hipparcos numbers of the m stars that may be used by themselves", (-1,), name="star_hip")
    u_c: number("", "where the nominal camera sees them, unit vectors, m x 3", (-1, 3), name="star_u_c")
    # of each by itself, along `pinhole.cross_axes`: e1 (camera x, made across the star), e2 = u x e1
    P_u: number("rad^2", "covariance of each along e1 and e2", (-1, 2, 2), name="star_P_u_rad2")
    u_i: number("", "where the moving vehicle sees them, inertial axes", (-1, 3), name="star_u_i")
    t_seen_s: number("s", "when the light was collected, from t_valid_s", (-1,), name="star_t_seen_s")
    # of the rate that carried them to t_valid_s, whose error all share
    P_omega_c: matrix("rad^2/s^2", "covariance of the rate to t_valid_s, camera axes", name="star_P_omega_c")
    sigma_focal: number("", "relative error of the focal length", name="star_sigma_focal") = 0.0


NO_STARS = StarVectors(
    np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 2, 2)), np.empty((0, 3)), np.empty(0),
    np.zeros((3, 3)),
)  # fmt: skip


class StarFix(NamedTuple):
    """Result of the star tracker chain for one frame, solved or not."""

    number: integer("of the frame")
    t_valid_s: T_VALID
    t_available_s: T_AVAILABLE
    reason: member(Reason, "why there is no attitude; none: there is one")
    q_ic: vector("", "attitude, camera to inertial axes, scalar first; NaN without fix", 4, name="q_ic_wxyz")
    P_c: matrix("rad^2", "covariance of the rotation-vector error but for what is constant, camera axes")
    detections: Detections
    hip: integer("Hipparcos number of each detection, 0 = unidentified", (-1,))
    residual_px: number("px", "RMS of the identified stars against the attitude, NaN without fix")
    background_dn: number("", "mean grey value")
    exposure_s: number("s", "")
    flag_saturated: flag("picture too bright")
    flag_no_stars: flag("fewer objects than an identification needs")
    scan: member(Scan, "how the objects were searched") = int(Scan.UNKNOWN)
    stars: StarVectors = NO_STARS
    # where the rate changes; else the mean of the exposure
    straight: flag("the attitude is that of t_valid_s also where the rate changes") = False


class GateResult(NamedTuple):
    """Fate of one measurement in the navigation filter."""

    t_s: number("s", "mission time at which it was processed")
    t_valid_s: T_VALID
    sensor: text("gps_position, gps_velocity, star_tracker, star_vectors ...")
    dof: integer("degrees of freedom")
    nis: number("", "normalised innovation squared")
    limit: number("", "accepted below it")
    accepted: flag("used by the filter")
    note: text("what else happened")  # '', 'rejected', 'reset after timeout', 'attitude reset' ...
    innovation: number("", "GPS: [m] or [m/s]; stars: [rad]", (-1,))


class NavHealth(NamedTuple):
    """Change in what the navigation thinks of a sensor, or of an axis of one."""

    t_s: T_S  # when it was noticed
    source: text("sensor, or axis of one: gyro x, accelerometer z, imu, gps, gps_position ...")
    healthy: flag("whether it is used again")
    reason: text("why it is not")


class Doubt(IntEnum):
    """Why position, velocity or attitude must not be used; NONE when it may."""

    NONE = 0
    LEVEL = 1  # its protection level exceeds what the mission requires
    CONTRADICTED = 2  # a sensor contradicts it, and nothing says which of the two is wrong
    IMU = 3  # rates or specific force of the moment are not measured
    SOFTWARE = 4  # navigation software of a user's own says so


UNKNOWN = np.full(3, np.nan)  # protection level


class NavSolution(NamedTuple):
    """What the canard controller gets, 100 times a second."""

    t_s: T_S
    r_i: vector("m", "position of the IMU, inertial axes")
    v_i: vector("m/s", "velocity, inertial axes")
    q_ib: Q_IB
    omega_ib_b: vector("rad/s", "rate, corrected for the estimated gyro errors, body axes")
    r_e: vector("m", "position, Earth-fixed axes")
    v_e: vector("m/s", "velocity relative to the Earth, Earth-fixed axes")
    flight_path_angle: number("rad", "of v_e above the horizontal")
    heading: number("rad", "of v_e, from north over east")
    angle_of_attack: number("", "[rad], atan2(v_z, v_x) in axes b, no wind", name="angle_of_attack_rad")
    sideslip: number("", "[rad], asin(v_y / |v|) likewise", name="sideslip_rad")
    sigma_r_e: vector("m", "standard deviations of r_e")
    sigma_v_e: vector("m/s", "standard deviations of v_e")
    sigma_theta_b: vector("rad", "standard deviations of the attitude, body axes")
    sigma_omega_b: vector("rad/s", "standard deviations of the rate")
    sigma_flight_path_angle: number("rad", "standard deviation")
    sigma_angle_of_attack: number("rad", "standard deviation")
    sigma_sideslip: number("rad", "standard deviation")
    star_aided: flag("a star fix has been used since the start")
    protection_position: vector("m", "protection level, horizontal and vertical", 2) = UNKNOWN[:2]
    protection_velocity: vector("m/s", "protection level of v_e, horizontal and vertical", 2) = UNKNOWN[:2]
    protection_attitude: vector("rad", "protection level of the attitude, body axes") = UNKNOWN
    do_not_use_position: flag("the position must not be used") = False
    do_not_use_velocity: flag("the velocity must not be used") = False
    do_not_use_attitude: flag("the attitude must not be used") = False
    doubt_position: member(Doubt, "why not") = int(Doubt.NONE)
    doubt_velocity: member(Doubt, "why not") = int(Doubt.NONE)
    doubt_attitude: member(Doubt, "why not") = int(Doubt.NONE)


class Protected(NamedTuple):
    """What a NavSolution says of how far one of its quantities can be trusted, of a record or of arrays."""

    level: np.ndarray  # protection level along each axis
    do_not_use: np.ndarray
    doubt: np.ndarray


QUANTITIES = ("position", "velocity", "attitude")  # what has a protection level


def protected(solution, quantity):
    """Protected of one of QUANTITIES. NavSolution, str -> Protected"""
    fields = "protection", "do_not_use", "doubt"
    return Protected(*(getattr(solution, f"{field}_{quantity}") for field in fields))


class NavCovariance(NamedTuple):
    """Covariance of position, velocity (inertial) and attitude error (body), and the calibration states."""

    t_s: T_S
    P: matrix("", "position i [m], velocity i [m/s], attitude b [rad]", 9)
    gyro_bias: vector("rad/s", "estimated, body axes")
    accel_bias: vector("m/s^2", "estimated, body axes")
    gyro_roll_column: vector("", "scale factor error and misalignments: on x, y, z per unit of roll rate")
    mounting: vector("rad", "estimated rotation of the camera against its nominal mounting, body axes")
    sigma: vector("", "standard deviations of the four above, in that order; NaN: no state", 12)
    states: text("optional blocks of the filter, in order, separated by blanks") = ""
    estimates: number("", "of those blocks, in the units of these", (-1,)) = np.empty(0)
    sigmas: number("", "standard deviations of those", (-1,)) = np.empty(0)


class ComputeTime(NamedTuple):
    """Measured durations, kept apart from everything that must be reproducible."""

    t_s: float  # mission time
    frame_number: int
    chain_s: float  # star tracker chain of one frame


def row(arrays, k):
    """Record k of a record of arrays."""
    return type(arrays)(*(column[k].item() if column.ndim == 1 else column[k] for column in arrays))


def rows(arrays):
    """All records of a record of arrays: list."""
    columns = (column.tolist() if column.ndim == 1 else list(column) for column in arrays)
    return list(map(type(arrays)._make, zip(*columns, strict=True)))
