"""The table of the log: which record goes to which topic, under which schema, how often.

Every message is protobuf. Where Foxglove has a schema that viewers draw, the record also goes there
(`log.drawings`); its full content goes to a schema of our own, package `shefex`, listed here. One line of
the table names a field of the message, the attribute of the record it holds, its type, its shape
(row-major), and what it is with frame and unit, which becomes the field's comment in the stored schema. New
fields go to the end of their message, with a default in the record: an older log, which lacks them, is read
with the default.

Rates are those of a log in full; `log.thinning` says which of them a scenario may lower.

`timestamp_ns` is UTC since 1970: epoch of the scenario (t = 0) plus the time of the record, which is also
its log time: `t_s`, or for a measurement `t_valid_s`, so that what belongs together stands together.
"""

import math
from datetime import UTC, datetime, timedelta
from functools import cache
from typing import NamedTuple, get_args, get_type_hints

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.geometry.frames import EarthRotation
from shefex_nav.geometry.pinhole import Pinhole
from shefex_nav.instruments import TABLE
from shefex_nav.records import (
    Alignment,
    CameraCommand,
    ControlSample,
    Doubt,
    Event,
    Frame,
    FrameTruth,
    GateResult,
    GpsFix,
    GpsRanges,
    ImuBlock,
    NavCovariance,
    NavHealth,
    NavSolution,
    Phase,
    Reason,
    Scan,
    StarFix,
    TruthSample,
)

FORMAT = "3"  # of this table; a reader refuses others
METADATA = "shefex_nav"  # name of the metadata record
ATTACHMENT = "scenario.yaml"


class LogError(UserError):
    """A log cannot be written or read; the message says why and is for people."""


class Mission(NamedTuple):
    """What one run is, and what a reader of its log must know to make sense of it."""

    scenario: str  # name
    scenario_text: str  # YAML
    seed: int
    version: str
    epoch_utc: str  # ISO 8601, t = 0
    start_s: float  # mission time at which the simulation starts
    earth: EarthRotation
    launch_latitude: float  # rad, geodetic, below the vehicle at the start; origin of the launch axes
    launch_longitude: float  # rad
    launch_height: float  # m, where it stands; 0 below an orbit
    camera: Pinhole  # as the on-board computer knows it
    C_bc: np.ndarray  # (3, 3) nominal mounting
    sun_i: np.ndarray = np.full(3, np.nan)  # (3,) direction of the Sun from the Earth at t = 0
    sun_exclusion: float = math.nan  # rad, that the camera must keep from the Sun
    limb_exclusion: float = math.nan  # rad, and from the Earth's limb
    plugins: tuple = ()  # of (file or name of a package, SHA-256 of its source)


class RunSummary(NamedTuple):
    """How long the run took."""

    t_s: float  # mission time at the end
    wall_s: float  # the mission, without setting up
    setup_s: float  # catalogue, compilation, trajectory
    until_s: float = math.nan  # where looking was ended before the mission did; NaN: it was seen to its end


class Timing(NamedTuple):
    """Content of the one topic that differs between two equal runs."""

    t_s: float
    frame_number: int  # -1 in the closing message
    chain_s: float
    wall_s: float  # NaN but in the closing message
    setup_s: float
    until_s: float = math.nan  # as in RunSummary


def timing(record):
    """Timing of a records.ComputeTime or of the RunSummary."""
    if isinstance(record, RunSummary):
        return Timing(record.t_s, -1, math.nan, record.wall_s, record.setup_s, record.until_s)
    return Timing(*record, math.nan, math.nan)


EQUAL = -2


class Field(NamedTuple):
    """One field of a message."""

    name: str
    source: str  # attribute of the record, dotted where nested
    kind: str  # double, bool, sfixed32, string, or an IntEnum
    shape: tuple  # of the array; () = scalar, -1 = any number of rows, EQUAL = any, the same in a whole log
    comment: str


class Topic(NamedTuple):
    """One line of the log's table of contents."""

    record: type
    topic: str
    schema: str
    rate_hz: float | None  # nominal; None = as it happens
    time: str  # attribute of the record that is its log time
    comment: str
    fields: tuple[Field, ...]


def _number(name, source, comment, shape=()):
    return Field(name, source, "double", shape, comment)


def _vector(name, source, comment, n=3):
    return Field(name, source, "double", (n,), comment)


def _matrix(name, source, comment, n=3):
    return Field(name, source, "double", (n, n), f"{comment}, {n} x {n} row by row")


def _integer(name, source, comment, shape=()):
    return Field(name, source, "sfixed32", shape, comment)


def _flag(name, source, comment):
    return Field(name, source, "bool", (), comment)


def _text(name, source, comment):
    return Field(name, source, "string", (), comment)


T_S = _number("t_s", "t_s", "mission time, from lift-off [s]")
T_VALID = _number("t_valid_s", "t_valid_s", "mission time that is measured [s]")
T_AVAILABLE = _number(
    "t_available_s", "t_available_s", "mission time at which the on-board computer has it [s]"
)
Q_IB = _vector("q_ib_wxyz", "q_ib", "attitude, body to inertial axes, Hamilton, scalar first", 4)

OWN = (
    Topic(TruthSample, "/truth/state", "Truth", 100, "t_s", "What happens, at every tick.", (
        T_S,
        Field("phase", "phase", Phase, (), "phase of the mission"),
        _vector("r_i_m", "r_i", "position of the IMU, inertial axes [m]"),
        _vector("v_i_m_s", "v_i", "velocity, inertial axes [m/s]"),
        Q_IB,
        _vector("omega_ib_b_rad_s", "omega_ib_b", "rate of b against i, body axes [rad/s]"),
        _vector("f_b_m_s2", "f_b", "specific force at the IMU, body axes [m/s^2]"),
        _number("angle_of_attack_rad", "angle_of_attack", "total, roll axis against the air [rad]"),
    )),
    Topic(ControlSample, "/truth/attitude_control", "AttitudeControl", 10, "t_s",
          "The cold-gas system, while it steers.", (
        T_S,
        _vector("pointing_error_rad", "pointing_error",
                "true against wanted attitude, body axes; NaN about axes that are left alone [rad]"),
        _vector("torque_b_n_m", "torque_b", "torque of the valves, body axes [N m]"),
        _number("propellant_kg", "propellant_kg", "gas used since the start [kg]"),
    )),
    Topic(ImuBlock, "/imu", "ImuBlock", 100, "t_valid_s", "The IMU samples of a tick, oldest first.", (
        T_VALID,
        T_AVAILABLE,
        _number("dt_s", "dt_s", "duration of one sample [s]"),
        _number("dtheta_b_rad", "dtheta_b", "integrated rate, body axes, n x 3 row by row [rad]", (EQUAL, 3)),
        _number("dv_b_m_s", "dv_b", "integrated specific force, body axes, n x 3 [m/s]", (EQUAL, 3)),
        _flag("saturated", "saturated", "a sample reached the range of its sensor"),
        _flag("valid", "valid", "false: the unit did not answer, the samples are NaN"),
    )),
    Topic(GpsFix, "/gps/fix", "GpsFix", 1, "t_valid_s", "Position and velocity of the GPS antenna a.", (
        T_VALID,
        T_AVAILABLE,
        _flag("valid", "valid", "false while there is no solution"),
        _vector("r_ea_e_m", "r_ea_e", "position, Earth-fixed axes [m]"),
        _vector("v_ea_e_m_s", "v_ea_e", "velocity relative to the Earth, Earth-fixed axes [m/s]"),
        _matrix("R_r_e_m2", "R_r_e", "covariance of the position [m^2]"),
        _matrix("R_v_e_m2_s2", "R_v_e", "covariance of the velocity [m^2/s^2]"),
        _integer("n_satellites", "n_satellites", "satellites used"),
        _number("pdop", "pdop", "dilution of precision, position"),
        _text("reason", "reason", "why there is no fix"),
        _flag("horizontal", "horizontal", "latitude and longitude alone: the height of r_ea_e means nothing"),
    )),
    Topic(GpsRanges, "/gps/ranges", "GpsRanges", 1, "t_valid_s", "What the channels of the receiver say.", (
        T_VALID,
        T_AVAILABLE,
        _integer("prn", "prn", "number of each satellite", (-1,)),
        _number("pseudorange_m", "pseudorange", "with the bias of the receiver's clock [m]", (-1,)),
        _number("range_rate_m_s", "range_rate", "with the drift of the receiver's clock [m/s]", (-1,)),
        _number("r_es_e_m", "r_es_e",
                "satellite at transmission, Earth-fixed axes of t_valid_s, n x 3 row by row [m]", (-1, 3)),
        _number("v_es_e_m_s", "v_es_e",
                "velocity relative to these axes, which turn with the Earth, n x 3 [m/s]", (-1, 3)),
        _number("sigma_range_m", "sigma_range", "noise of the pseudorange, standard deviation [m]", (-1,)),
        _number("sigma_range_rate_m_s", "sigma_range_rate", "noise of the range rate [m/s]", (-1,)),
        _text("reason", "reason", "why no satellite is tracked"),
    )),
    Topic(Alignment, "/nav/alignment", "Alignment", None, "t_valid_s", "What the navigation starts from.", (
        T_VALID,
        _vector("r_i_m", "r_i", "position of the IMU, inertial axes [m]"),
        _vector("v_i_m_s", "v_i", "velocity, inertial axes [m/s]"),
        Q_IB,
        _number("sigma_r_m", "sigma_r", "standard deviation of each axis [m]"),
        _number("sigma_v_m_s", "sigma_v", "standard deviation of each axis [m/s]"),
        _matrix("P_theta_b_rad2", "P_theta_b", "covariance of the attitude error, body axes [rad^2]"),
        _number("gyro_bias_rad_s", "gyro_bias", "gyro bias found while aligning, if any [rad/s]", (-1,)),
        _number("sigma_gyro_bias_rad_s", "sigma_gyro_bias", "its standard deviation, each axis [rad/s]"),
    )),
    Topic(NavSolution, "/nav/solution", "NavSolution", 100, "t_s", "The navigation's output.", (
        T_S,
        _vector("r_i_m", "r_i", "position of the IMU, inertial axes [m]"),
        _vector("v_i_m_s", "v_i", "velocity, inertial axes [m/s]"),
        Q_IB,
        _vector("omega_ib_b_rad_s", "omega_ib_b", "corrected rate, body axes [rad/s]"),
        _vector("r_e_m", "r_e", "position, Earth-fixed axes [m]"),
        _vector("v_e_m_s", "v_e", "velocity relative to the Earth, Earth-fixed axes [m/s]"),
        _number("flight_path_angle_rad", "flight_path_angle", "of v_e above the horizontal [rad]"),
        _number("heading_rad", "heading", "of v_e, from north over east [rad]"),
        _number("angle_of_attack_rad", "angle_of_attack", "[rad], no wind"),
        _number("sideslip_rad", "sideslip", "[rad], no wind"),
        _vector("sigma_r_e_m", "sigma_r_e", "standard deviations of r_e [m]"),
        _vector("sigma_v_e_m_s", "sigma_v_e", "standard deviations of v_e [m/s]"),
        _vector("sigma_theta_b_rad", "sigma_theta_b", "standard deviations of the attitude, body axes [rad]"),
        _vector("sigma_omega_b_rad_s", "sigma_omega_b", "standard deviations of the rate [rad/s]"),
        _number("sigma_flight_path_angle_rad", "sigma_flight_path_angle", "standard deviation [rad]"),
        _number("sigma_angle_of_attack_rad", "sigma_angle_of_attack", "standard deviation [rad]"),
        _number("sigma_sideslip_rad", "sigma_sideslip", "standard deviation [rad]"),
        _flag("star_aided", "star_aided", "a star fix has been used since the start"),
        _vector("protection_position_m", "protection_position",
                "protection level of the position, horizontal and vertical [m]", 2),
        _vector("protection_velocity_m_s", "protection_velocity",
                "protection level of v_e, horizontal and vertical [m/s]", 2),
        _vector("protection_attitude_rad", "protection_attitude",
                "protection level of the attitude, body axes [rad]"),
        _flag("do_not_use_position", "do_not_use_position", "the position must not be used"),
        _flag("do_not_use_velocity", "do_not_use_velocity", "the velocity must not be used"),
        _flag("do_not_use_attitude", "do_not_use_attitude", "the attitude must not be used"),
        Field("doubt_position", "doubt_position", Doubt, (), "why not"),
        Field("doubt_velocity", "doubt_velocity", Doubt, (), "why not"),
        Field("doubt_attitude", "doubt_attitude", Doubt, (), "why not"),
    )),
    Topic(NavCovariance, "/nav/covariance", "NavCovariance", 10, "t_s", "Covariance, calibration states.", (
        T_S,
        _matrix("P", "P", "position i [m], velocity i [m/s], attitude b [rad]", 9),
        _vector("gyro_bias_rad_s", "gyro_bias", "estimated, body axes [rad/s]"),
        _vector("accel_bias_m_s2", "accel_bias", "estimated, body axes [m/s^2]"),
        _vector("gyro_roll_column", "gyro_roll_column", "estimated errors on x, y, z per unit of roll rate"),
        _vector("mounting_rad", "mounting", "estimated rotation of the camera's mounting, body axes [rad]"),
        _vector("sigma", "sigma", "standard deviations of the four above, in that order; NaN: no state", 12),
        _text("states", "states", "optional blocks of the filter, in order, separated by blanks"),
        _number("estimates", "estimates", "of those blocks", (-1,)),
        _number("sigmas", "sigmas", "standard deviations of those", (-1,)),
    )),
    Topic(GateResult, "/nav/gates", "Gate", None, "t_s", "Fate of one measurement in the filter.", (
        _number("t_s", "t_s", "mission time at which it was processed [s]"),
        T_VALID,
        _text("sensor", "sensor", "gps_position, gps_velocity, star_tracker, star_vectors ..."),
        _integer("dof", "dof", "degrees of freedom"),
        _number("nis", "nis", "normalised innovation squared"),
        _number("limit", "limit", "accepted below it"),
        _flag("accepted", "accepted", "used by the filter"),
        _text("note", "note", "what else happened"),
        _number("innovation", "innovation", "GPS: [m] or [m/s]; stars: [rad]", (-1,)),
    )),
    Topic(NavHealth, "/nav/health", "NavHealth", None, "t_s", "What the navigation thinks of a sensor.", (
        T_S,
        _text("source", "source", "sensor, or axis of one"),
        _flag("healthy", "healthy", "whether it is used again"),
        _text("reason", "reason", "why it is not"),
    )),
    Topic(Frame, "/star_tracker/frame", "FrameInfo", 10, "t_valid_s", "One picture, without its pixels.", (
        _integer("number", "number", "of the frame"),
        _number("t_start_s", "t_start_s", "mission time at which the shutter opens [s]"),
        T_VALID,
        T_AVAILABLE,
        _number("exposure_s", "exposure_s", "[s]"),
        _number("gain_db", "gain_db", "[dB]"),
        _number("line_s", "line_s", "from the start of one row to that of the next, 0 = global shutter [s]"),
        _integer("bits", "bits", "of a grey value, which is at most 2^bits - 1"),
    )),
    Topic(StarFix, "/star_tracker/fix", "StarFix", 10, "t_valid_s", "What came out of one frame.", (
        _integer("number", "number", "of the frame"),
        T_VALID,
        T_AVAILABLE,
        Field("reason", "reason", Reason, (), "why there is no attitude, NONE when there is"),
        _vector("q_ic_wxyz", "q_ic", "attitude, camera to inertial axes, scalar first; NaN without fix", 4),
        _matrix("P_c_rad2", "P_c", "covariance of the rotation-vector error, camera axes [rad^2]"),
        _number("xy_px", "detections.xy_px", "centroids, x and y in turn [px]", (-1, 2)),
        _number("flux_dn", "detections.flux_dn", "grey values above the background, summed", (-1,)),
        _integer("n_pixels", "detections.n_pixels", "pixels of each detection", (-1,)),
        _integer("n_saturated", "detections.n_saturated", "saturated pixels of each detection", (-1,)),
        _number("P_px2", "detections.P_px", "covariance of each centroid [px^2]", (-1, 2, 2)),
        _integer("hip", "hip", "Hipparcos number of each detection, 0 = unidentified", (-1,)),
        _number("residual_px", "residual_px", "RMS of the identified stars against the attitude [px]"),
        _number("background_dn", "background_dn", "mean grey value"),
        _number("exposure_s", "exposure_s", "[s]"),
        _flag("flag_saturated", "flag_saturated", "picture too bright"),
        _flag("flag_no_stars", "flag_no_stars", "fewer objects than an identification needs"),
        Field("scan", "scan", Scan, (), "how the objects were searched"),
        _integer("star_hip", "stars.hip", "Hipparcos numbers of the m stars that may be used by themselves",
                 (-1,)),
        _number("star_u_c", "stars.u_c", "where the nominal camera sees them, unit vectors, m x 3", (-1, 3)),
        _number("star_P_u_rad2", "stars.P_u",
                "covariance of each along the cross axes e1 (camera x, made perpendicular to the star) and "
                "e2 = u x e1 [rad^2]", (-1, 2, 2)),
        _number("star_u_i", "stars.u_i", "where the moving vehicle sees them, inertial axes, m x 3", (-1, 3)),
        _number("star_t_seen_s", "stars.t_seen_s", "when each was seen, from t_valid_s [s]", (-1,)),
        _matrix("star_P_omega_c", "stars.P_omega_c",
                "covariance of the rate that carried them to t_valid_s, camera axes [rad^2/s^2]"),
        _number("star_sigma_focal", "stars.sigma_focal", "relative error of the focal length"),
    )),
    Topic(CameraCommand, "/star_tracker/command", "CameraCommand", 10, "t_s", "Asked of the camera next.", (
        T_S,
        _number("exposure_s", "exposure_s", "[s]"),
        _number("gain_db", "gain_db", "[dB]"),
    )),
    Topic(FrameTruth, "/truth/frame", "FrameTruth", 10, "t_valid_s", "What the camera really looked at.", (
        _integer("number", "number", "of the frame"),
        T_VALID,
        _vector("q_ic_wxyz", "q_ic", "true attitude, camera to inertial axes, mounting error included", 4),
        _number("rate_rad_s", "rate", "largest body rate during the exposure [rad/s]"),
        _number("sun_angle_rad", "sun_angle", "boresight to the Sun [rad]"),
        _number("limb_angle_rad", "limb_angle", "boresight to the Earth's limb, positive above [rad]"),
        _flag("exclusion_met", "exclusion_met", "both angles outside their exclusion"),
        _integer("hip", "hip", "Hipparcos numbers of the brightest stars on the detector", (-1,)),
        _number("xy_px", "xy_px", "where they are at t_valid_s, x and y in turn [px]", (-1, 2)),
    )),
    Topic(Event, "/events", "Event", None, "t_s", "Something that happened in the mission.", (
        T_S,
        _text("name", "name", "what"),
        _number("altitude_m", "altitude_m", "above the ellipsoid [m]"),
        _text("detail", "detail", "for people"),
    )),
    Topic(Timing, "/timing", "ComputeTime", None, "t_s", "Measured durations; differ from run to run.", (
        T_S,
        _integer("frame_number", "frame_number", "star camera frame; -1 in the closing message"),
        _number("chain_s", "chain_s", "star tracker chain of that frame [s]"),
        _number("wall_s", "wall_s", "closing message: the whole mission [s]"),
        _number("setup_s", "setup_s", "closing message: setting up [s]"),
        _number("until_s", "until_s",
                "closing message: mission time at which looking ended before the mission did; or NaN [s]"),
    )),
    Topic(Mission, "/mission", "Mission", None, "start_s", "Constants of this run.", (
        _number("start_s", "start_s", "mission time of the first record [s]"),
        _matrix("C_iq", "earth.C_iq", "celestial intermediate frame to inertial axes"),
        _matrix("C_re", "earth.C_re", "Earth-fixed axes to terrestrial intermediate frame"),
        _number("earth_angle_0_rad", "earth.angle_0", "Earth rotation angle at t = 0 [rad]"),
        _number("earth_rate_rad_s", "earth.rate", "rotation rate of the Earth [rad/s]"),
        _number("launch_latitude_rad", "launch_latitude", "of the origin of the launch axes, geodetic [rad]"),
        _number("launch_longitude_rad", "launch_longitude", "likewise [rad]"),
        _number("launch_height_m", "launch_height", "likewise, above the ellipsoid [m]"),
        _integer("width_px", "camera.width_px", "detector [px]"),
        _integer("height_px", "camera.height_px", "detector [px]"),
        _number("focal_length_px", "camera.focal_length_px", "nominal [px]"),
        _number("cx_px", "camera.cx_px", "principal point [px]"),
        _number("cy_px", "camera.cy_px", "principal point [px]"),
        _matrix("C_bc", "C_bc", "nominal mounting, camera to body axes"),
        _vector("sun_i", "sun_i", "direction of the Sun from the Earth at t = 0, inertial axes"),
        _number("sun_exclusion_rad", "sun_exclusion", "that the camera must keep from the Sun [rad]"),
        _number("limb_exclusion_rad", "limb_exclusion", "that it must keep from the Earth's limb [rad]"),
    )),
)  # fmt: skip


def topics():
    """The whole table: that of the program, and a topic for each instrument that is known now."""
    return (*OWN, *(_of_instrument(one) for one in TABLE.values()))


def of_record(record):
    """Topic of a type of record."""
    return next(topic for topic in topics() if topic.record is record)


@cache
def _of_instrument(one):
    """Topic of the readings of an Instrument: names carry the unit, comments too."""
    fields = [T_VALID, T_AVAILABLE]
    for source, kind in get_type_hints(one.record, include_extras=True).items():
        if source in ("t_valid_s", "t_available_s"):
            continue
        own, column = get_args(kind)
        unit = column.unit.lower().replace("/", "_").replace("^", "")
        name, words = (
            (f"{source}_{unit}", f"{column.help} [{column.unit}]") if unit else (source, column.help)
        )
        log_kind = {bool: "bool", int: "sfixed32", str: "string"}.get(own, "double")
        fields.append(Field(name, source, log_kind, column.shape, words))
    schema = "".join(part.title() for part in one.name.split("_"))
    comment = (one.record.__doc__ or "").strip().partition("\n")[0]
    return Topic(one.record, f"/{one.name}", schema, None, "t_valid_s", comment, tuple(fields))


def epoch_ns(epoch_utc):
    """Nanoseconds since 1970 of an ISO 8601 instant; UTC when it names no zone."""
    instant = datetime.fromisoformat(epoch_utc)
    if instant.tzinfo is None:
        instant = instant.replace(tzinfo=UTC)
    return (instant - datetime(1970, 1, 1, tzinfo=UTC)) // timedelta(microseconds=1) * 1000


def log_time_ns(epoch, t_s):
    """Log time of mission times t_s, `epoch` in nanoseconds since 1970. int, (n,) -> (n,) int64."""
    return epoch + np.rint(t_s * 1e9).astype(np.int64)
