"""The data that flows: what passes between world, on-board computer, log and report.

Every record is an immutable tuple in SI units and radians; the last letter of a vector names the frame
of its components (frames and rotations: package docstring). A measurement carries `t_valid_s`, the
instant that it measures, and `t_available_s`, the instant at which the on-board computer has it.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np


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

    t_s: float
    phase: int  # Phase
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s
    q_ib: np.ndarray  # (4,)
    omega_ib_b: np.ndarray  # (3,) rad/s
    f_b: np.ndarray  # (3,) m/s^2
    angle_of_attack: float  # rad, total: roll axis against the air-relative velocity


class ControlSample(NamedTuple):
    """The attitude control as flown (truth) at one instant, for the log."""

    t_s: float
    pointing_error: np.ndarray  # (3,) rad, body axes: wanted attitude -> true one; NaN where none is wanted
    torque_b: np.ndarray  # (3,) N m, of the valves
    propellant_kg: float  # used since the start


class Event(NamedTuple):
    """Something that happened in the mission."""

    t_s: float
    name: str  # lower case with underscores: lift_off, burn_out_1, apogee, entry, impact ...
    altitude_m: float
    detail: str  # for people; may be empty


class Alignment(NamedTuple):
    """Where the launch crew says the vehicle stands before lift-off; starts the navigation."""

    t_valid_s: float
    r_i: np.ndarray  # (3,) m, IMU
    v_i: np.ndarray  # (3,) m/s
    q_ib: np.ndarray  # (4,)
    sigma_r: float  # m, each axis
    sigma_v: float  # m/s, each axis
    P_theta_b: np.ndarray  # (3, 3) rad^2, covariance of the attitude error in body axes
    gyro_bias: np.ndarray = np.empty(0)  # (3,) rad/s, found while aligning; (0,) if it was not
    sigma_gyro_bias: float = 0.0  # rad/s, of that, each axis


class ImuBlock(NamedTuple):
    """The IMU samples of one tick, oldest first, the last ends at the tick: four at 400 Hz and 100 Hz."""

    t_valid_s: float  # end of the last sample
    t_available_s: float  # at which the computer has it
    dt_s: float  # duration of one sample
    dtheta_b: np.ndarray  # (n, 3) rad, integrated rate
    dv_b: np.ndarray  # (n, 3) m/s, integrated specific force
    saturated: bool  # a sample of this block reached the range of its sensor
    valid: bool = True  # False: the unit did not answer, its increments (NaN in a flight) mean nothing


class GpsFix(NamedTuple):
    """Position and velocity of the GPS antenna a; valid is False while there is no solution."""

    t_valid_s: float  # mission time of the instant measured
    t_available_s: float  # at which the computer has it
    valid: bool  # whether there is a solution
    r_ea_e: np.ndarray  # (3,) m, place of the antenna, Earth-fixed axes e
    v_ea_e: np.ndarray  # (3,) m/s, its velocity relative to the Earth, axes e; NaN: the receiver gives none
    R_r_e: np.ndarray  # (3, 3) m^2, covariance as the receiver reports it
    R_v_e: np.ndarray  # (3, 3) m^2/s^2
    n_satellites: int  # used in the fix
    pdop: float  # position dilution of precision
    reason: str  # why there is no fix; empty when valid
    # latitude and longitude alone: r_ea_e lies at any height above the place or below it, R_r_e has no part
    # along the vertical there, and of the velocity nothing is known
    horizontal: bool = False


class GpsRanges(NamedTuple):
    """What the receiver's channels measure at one instant; n satellites are tracked, and there may be none.

    A pseudorange is the distance from the satellite at transmission to the antenna at t_valid_s, plus the
    bias of the receiver's clock; what is broadcast about the satellite's clock and the ionosphere, and a
    model of the troposphere, have been taken out. A range rate is its change in time, likewise.
    """

    t_valid_s: float
    t_available_s: float
    prn: np.ndarray  # (n,) int, ascending; of an almanac, or slots 1 to 24 of the nominal constellation
    pseudorange: np.ndarray  # (n,) m
    range_rate: np.ndarray  # (n,) m/s, positive as the distance grows
    r_es_e: np.ndarray  # (n, 3) m, satellite at transmission as broadcast, in the axes e of t_valid_s
    v_es_e: np.ndarray  # (n, 3) m/s, its velocity relative to these axes, which turn with the Earth
    sigma_range: np.ndarray  # (n,) m, noise of the channel as the receiver reports it; white in time
    sigma_range_rate: np.ndarray  # (n,) m/s
    reason: str = ""  # why no satellite is tracked; empty otherwise


class CameraCommand(NamedTuple):
    """What the star tracker asks of the camera for the next frame."""

    t_s: float
    exposure_s: float
    gain_db: float


class Frame(NamedTuple):
    """One picture of the star camera."""

    number: int
    t_start_s: float  # shutter opens, over the first row
    t_valid_s: float  # middle of the exposure of the middle row
    t_available_s: float  # read out and in the computer's memory
    exposure_s: float  # of every row
    gain_db: float
    image_dn: np.ndarray  # (rows, columns) uint8, or uint16 of a detector with more bits
    line_s: float = 0.0  # from the start of one row to the next; 0: global shutter
    bits: int = 8  # of a grey value: it is at most 2^bits - 1


class FrameTruth(NamedTuple):
    """What the camera really looked at, for scoring and the log; never seen on board."""

    number: int
    t_valid_s: float
    q_ic: np.ndarray  # (4,) true attitude of the camera at t_valid_s, mounting error included
    rate: float  # rad/s, largest true body rate during the exposure
    sun_angle: float  # rad, boresight to the Sun
    limb_angle: float  # rad, boresight to the Earth's limb, positive above it
    exclusion_met: bool  # both angles outside their exclusion
    hip: np.ndarray  # (n,) Hipparcos numbers of the brightest catalogue stars on the detector
    xy_px: np.ndarray  # (n, 2) where they are at t_valid_s


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

    xy_px: np.ndarray  # (n, 2) where they are at the frame's t_valid_s
    flux_dn: np.ndarray  # (n,) light in grey values above the background
    n_pixels: np.ndarray  # (n,) int, above the growth threshold
    n_saturated: np.ndarray  # (n,) int, saturated pixels
    P_px: np.ndarray  # (n, 2, 2) covariance of the centroid [px^2], of the noise alone


class StarVectors(NamedTuple):
    """Stars of one frame that may be used each by itself, m of them; their directions need no corrections.

    The stars that made the attitude, without those that did not fit; in a frame without attitude the one or
    two that a prediction leaves no doubt about, if the navigation asks for them.
    """

    hip: np.ndarray  # (m,) Hipparcos numbers
    u_c: np.ndarray  # (m, 3) where the nominal camera sees them at t_valid_s, unit vectors
    P_u: np.ndarray  # (m, 2, 2) rad^2, covariance of u_c along `pinhole.cross_axes`, of each star by itself
    u_i: np.ndarray  # (m, 3) where the moving vehicle sees them: proper motion and aberration are in it
    t_seen_s: np.ndarray  # (m,) s after t_valid_s, when the light was collected; a rate has carried it over
    P_omega_c: np.ndarray  # (3, 3) (rad/s)^2, covariance of that rate, whose error all stars share
    sigma_focal: float = 0.0  # relative error of the focal length, which they share as well


NO_STARS = StarVectors(
    np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 2, 2)), np.empty((0, 3)), np.empty(0),
    np.zeros((3, 3)),
)  # fmt: skip


class StarFix(NamedTuple):
    """Result of the star tracker chain for one frame, solved or not."""

    number: int  # of the frame
    t_valid_s: float
    t_available_s: float
    reason: int  # Reason; NONE = attitude is good
    q_ic: np.ndarray  # (4,) attitude of the camera; NaN without a fix
    P_c: np.ndarray  # (3, 3) rad^2, covariance of the rotation-vector error in camera axes, without what
    # is constant in a run (principal point); NaN likewise
    detections: Detections
    hip: np.ndarray  # (n,) Hipparcos number of each detection, 0 where unidentified
    residual_px: float  # RMS of identified stars against the attitude, NaN without a fix
    background_dn: float  # mean grey value of the frame
    exposure_s: float
    flag_saturated: bool
    flag_no_stars: bool
    scan: int = int(Scan.UNKNOWN)  # Scan
    stars: StarVectors = NO_STARS
    # whether the attitude is that of t_valid_s also where the rate changes; else the mean of the exposure
    straight: bool = False


class GateResult(NamedTuple):
    """Fate of one measurement in the navigation filter."""

    t_s: float  # when it was processed
    t_valid_s: float
    sensor: str  # 'gps_position', 'gps_velocity', 'star_tracker', 'star_vectors' ...
    dof: int
    nis: float  # normalised innovation squared
    limit: float  # accepted below it
    accepted: bool
    note: str  # '', 'rejected', 'reset after timeout', 'attitude reset' ...
    innovation: np.ndarray  # (dof,)


class NavHealth(NamedTuple):
    """Change in what the navigation thinks of a sensor, or of an axis of one."""

    t_s: float  # when it was noticed
    source: str  # 'gyro x', 'accelerometer z', 'imu', 'gps', 'gps_position', 'star_tracker' ...
    healthy: bool
    reason: str  # why not; empty when healthy again


class Doubt(IntEnum):
    """Why position, velocity or attitude must not be used; NONE when it may."""

    NONE = 0
    LEVEL = 1  # its protection level exceeds what the mission requires
    CONTRADICTED = 2  # a sensor contradicts it, and nothing says which of the two is wrong
    IMU = 3  # rates or specific force of the moment are not measured
    SOFTWARE = 4  # navigation software of a user's own says so


class NavSolution(NamedTuple):
    """What the canard controller gets, 100 times a second."""

    t_s: float
    r_i: np.ndarray  # (3,) m, IMU
    v_i: np.ndarray  # (3,) m/s
    q_ib: np.ndarray  # (4,)
    omega_ib_b: np.ndarray  # (3,) rad/s, corrected for the estimated gyro errors
    r_e: np.ndarray  # (3,) m
    v_e: np.ndarray  # (3,) m/s, relative to the rotating Earth
    flight_path_angle: float  # rad, of v_e above the local horizontal
    heading: float  # rad, of v_e, from north over east
    angle_of_attack: float  # rad, atan2(v_z, v_x) of the air-relative velocity in b, no wind
    sideslip: float  # rad, asin(v_y / |v|)
    sigma_r_e: np.ndarray  # (3,) m
    sigma_v_e: np.ndarray  # (3,) m/s
    sigma_theta_b: np.ndarray  # (3,) rad
    sigma_omega_b: np.ndarray  # (3,) rad/s
    sigma_flight_path_angle: float  # rad
    sigma_angle_of_attack: float  # rad
    sigma_sideslip: float  # rad
    star_aided: bool  # a star fix has been used since the start
    protection_position: np.ndarray = np.full(2, np.nan)  # (2,) m, protection level, horizontal and vertical
    protection_velocity: np.ndarray = np.full(2, np.nan)  # (2,) m/s, against the Earth, likewise
    protection_attitude: np.ndarray = np.full(3, np.nan)  # (3,) rad, about the body axes
    do_not_use_position: bool = False
    do_not_use_velocity: bool = False
    do_not_use_attitude: bool = False
    doubt_position: int = int(Doubt.NONE)  # Doubt, why not
    doubt_velocity: int = int(Doubt.NONE)
    doubt_attitude: int = int(Doubt.NONE)


class Protected(NamedTuple):
    """What a NavSolution says of how far one of its quantities can be trusted, of a record or of arrays."""

    level: np.ndarray  # protection level along each axis
    do_not_use: np.ndarray
    doubt: np.ndarray


QUANTITIES = ("position", "velocity", "attitude")  # what has a protection level


def protected(solution, quantity):
    """Protected of one of QUANTITIES. NavSolution, str -> Protected"""
    return Protected(
        *(getattr(solution, f"{field}_{quantity}") for field in ("protection", "do_not_use", "doubt"))
    )


class NavCovariance(NamedTuple):
    """Covariance of position, velocity (inertial) and attitude error (body), and the calibration states.

    Of a block that is not estimated the sigma is NaN.
    """

    t_s: float
    P: np.ndarray  # (9, 9) order: position i [m], velocity i [m/s], attitude b [rad]
    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s^2
    gyro_roll_column: np.ndarray  # (3,) errors on x, y, z per unit of roll rate: scale factor, misalignments
    mounting: np.ndarray  # (3,) rad, rotation of the star camera against its nominal mounting, body axes
    sigma: np.ndarray  # (12,) standard deviations of the four above, in that order
    states: str = ""  # optional blocks of the filter, in order, separated by blanks
    estimates: np.ndarray = np.empty(0)  # (k,) of those blocks, units of onboard.navigation.state.OPTIONAL
    sigmas: np.ndarray = np.empty(0)  # (k,) standard deviations


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
