"""The table of the log: which record goes to which topic, under which schema, how often.

Every message is protobuf. Where Foxglove has a schema that viewers draw, the record also goes there
(`log.drawings`); its full content goes to a schema of our own, package `shefex`, listed here: a line of the
table is a field (`log.fields`). New fields go to the end of their message, with a default in the record: an
older log, which lacks them, is read with the default.

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
from shefex_nav.log.fields import (
    EQUAL,
    Topic,
    field,
    flag,
    integer,
    matrix,
    member,
    number,
    text,
    vector,
)
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
FAILED = "software_failed"  # name of the Event that ends the log of a flight whose software failed


class LogError(UserError):
    """A log cannot be written or read; the message says why and is for people."""


class LogExists(LogError):
    """A log would be overwritten, and nobody has said that it may be."""


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
    software: tuple = ()  # of a user's own on board: (section of the scenario, name, SHA-256)
    distortion: tuple = ()  # (k1, k2, p1, p2, k3) of the camera, `geometry.distortion`; (): a pinhole


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


T_S = number("t_s", "s", "mission time, from lift-off")
T_VALID = number("t_valid_s", "s", "mission time that is measured")
T_AVAILABLE = number("t_available_s", "s", "mission time at which the on-board computer has it")
Q_IB = vector("q_ib", "", "attitude, body to inertial axes, Hamilton, scalar first", 4, name="q_ib_wxyz")

EARTH = (  # frames.EarthRotation
    matrix("earth.C_iq", "", "celestial intermediate frame to inertial axes"),
    matrix("earth.C_re", "", "Earth-fixed axes to terrestrial intermediate frame"),
    number("earth.angle_0", "rad", "Earth rotation angle at t = 0", name="earth_angle_0_rad"),
    number("earth.rate", "rad/s", "rotation rate of the Earth", name="earth_rate_rad_s"),
)
CAMERA = (  # pinhole.Pinhole
    integer("camera.width_px", "detector [px]"),
    integer("camera.height_px", "detector [px]"),
    number("camera.focal_length_px", "px", "nominal"),
    number("camera.cx_px", "px", "principal point"),
    number("camera.cy_px", "px", "principal point"),
)

OWN = (
    Topic(TruthSample, "/truth/state", "Truth", 100, "t_s", "What happens, at every tick.", (
        T_S,
        member("phase", Phase, "phase of the mission"),
        vector("r_i", "m", "position of the IMU, inertial axes"),
        vector("v_i", "m/s", "velocity, inertial axes"),
        Q_IB,
        vector("omega_ib_b", "rad/s", "rate of b against i, body axes"),
        vector("f_b", "m/s^2", "specific force at the IMU, body axes"),
        number("angle_of_attack", "rad", "total, roll axis against the air"),
    )),
    Topic(ControlSample, "/truth/attitude_control", "AttitudeControl", 10, "t_s",
          "The cold-gas system, while it steers.", (
        T_S,
        vector("pointing_error", "rad",
               "true against wanted attitude, body axes; NaN about axes that are left alone"),
        vector("torque_b", "N m", "torque of the valves, body axes"),
        number("propellant_kg", "kg", "gas used since the start"),
    )),
    Topic(ImuBlock, "/imu", "ImuBlock", 100, "t_valid_s", "The IMU samples of a tick, oldest first.", (
        number("t_valid_s", "s", "mission time at the end of the last sample"),
        T_AVAILABLE,
        number("dt_s", "s", "duration of one sample"),
        number("dtheta_b", "rad", "integrated rate, body axes, n x 3, oldest sample first", (EQUAL, 3)),
        number("dv_b", "m/s", "integrated specific force, body axes, likewise", (EQUAL, 3)),
        flag("saturated", "a sample reached the range of its sensor"),
        flag("valid", "false: the unit did not answer, the samples are NaN"),
    )),
    Topic(GpsFix, "/gps/fix", "GpsFix", 1, "t_valid_s", "Position and velocity of the GPS antenna a.", (
        T_VALID,
        T_AVAILABLE,
        flag("valid", "false while there is no solution"),
        vector("r_ea_e", "m", "position, Earth-fixed axes"),
        vector("v_ea_e", "m/s", "velocity relative to the Earth, Earth-fixed axes"),
        matrix("R_r_e", "m^2", "covariance of the position"),
        matrix("R_v_e", "m^2/s^2", "covariance of the velocity"),
        integer("n_satellites", "satellites used"),
        number("pdop", "", "dilution of precision, position"),
        text("reason", "why there is no fix"),
        flag("horizontal", "latitude and longitude alone: the height of r_ea_e means nothing"),
    )),
    Topic(GpsRanges, "/gps/ranges", "GpsRanges", 1, "t_valid_s", "What the channels of the receiver say.", (
        T_VALID,
        T_AVAILABLE,
        integer("prn", "number of each satellite", (-1,)),
        number("pseudorange", "m", "with the bias of the receiver's clock", (-1,)),
        number("range_rate", "m/s", "with the drift of the receiver's clock", (-1,)),
        number("r_es_e", "m",
               "satellite at transmission, Earth-fixed axes of t_valid_s, n x 3 row by row", (-1, 3)),
        number("v_es_e", "m/s", "velocity relative to these axes, which turn with the Earth, n x 3", (-1, 3)),
        number("sigma_range", "m", "noise of the pseudorange, standard deviation", (-1,)),
        number("sigma_range_rate", "m/s", "noise of the range rate", (-1,)),
        text("reason", "why no satellite is tracked"),
    )),
    Topic(Alignment, "/nav/alignment", "Alignment", None, "t_valid_s", "What the navigation starts from.", (
        T_VALID,
        vector("r_i", "m", "position of the IMU, inertial axes"),
        vector("v_i", "m/s", "velocity, inertial axes"),
        Q_IB,
        number("sigma_r", "m", "standard deviation of each axis"),
        number("sigma_v", "m/s", "standard deviation of each axis"),
        matrix("P_theta_b", "rad^2", "covariance of the attitude error, body axes"),
        number("gyro_bias", "rad/s", "gyro bias found while aligning, if any", (-1,)),
        number("sigma_gyro_bias", "rad/s", "its standard deviation, each axis"),
    )),
    Topic(NavSolution, "/nav/solution", "NavSolution", 100, "t_s", "The navigation's output.", (
        T_S,
        vector("r_i", "m", "position of the IMU, inertial axes"),
        vector("v_i", "m/s", "velocity, inertial axes"),
        Q_IB,
        vector("omega_ib_b", "rad/s", "corrected rate, body axes"),
        vector("r_e", "m", "position, Earth-fixed axes"),
        vector("v_e", "m/s", "velocity relative to the Earth, Earth-fixed axes"),
        number("flight_path_angle", "rad", "of v_e above the horizontal"),
        number("heading", "rad", "of v_e, from north over east"),
        number("angle_of_attack", "", "[rad], no wind", name="angle_of_attack_rad"),
        number("sideslip", "", "[rad], no wind", name="sideslip_rad"),
        vector("sigma_r_e", "m", "standard deviations of r_e"),
        vector("sigma_v_e", "m/s", "standard deviations of v_e"),
        vector("sigma_theta_b", "rad", "standard deviations of the attitude, body axes"),
        vector("sigma_omega_b", "rad/s", "standard deviations of the rate"),
        number("sigma_flight_path_angle", "rad", "standard deviation"),
        number("sigma_angle_of_attack", "rad", "standard deviation"),
        number("sigma_sideslip", "rad", "standard deviation"),
        flag("star_aided", "a star fix has been used since the start"),
        vector("protection_position", "m", "protection level of the position, horizontal and vertical", 2),
        vector("protection_velocity", "m/s", "protection level of v_e, horizontal and vertical", 2),
        vector("protection_attitude", "rad", "protection level of the attitude, body axes"),
        flag("do_not_use_position", "the position must not be used"),
        flag("do_not_use_velocity", "the velocity must not be used"),
        flag("do_not_use_attitude", "the attitude must not be used"),
        member("doubt_position", Doubt, "why not"),
        member("doubt_velocity", Doubt, "why not"),
        member("doubt_attitude", Doubt, "why not"),
    )),
    Topic(NavCovariance, "/nav/covariance", "NavCovariance", 10, "t_s", "Covariance, calibration states.", (
        T_S,
        matrix("P", "", "position i [m], velocity i [m/s], attitude b [rad]", 9),
        vector("gyro_bias", "rad/s", "estimated, body axes"),
        vector("accel_bias", "m/s^2", "estimated, body axes"),
        vector("gyro_roll_column", "", "estimated errors on x, y, z per unit of roll rate"),
        vector("mounting", "rad", "estimated rotation of the camera's mounting, body axes"),
        vector("sigma", "", "standard deviations of the four above, in that order; NaN: no state", 12),
        text("states", "optional blocks of the filter, in order, separated by blanks"),
        number("estimates", "", "of those blocks", (-1,)),
        number("sigmas", "", "standard deviations of those", (-1,)),
    )),
    Topic(GateResult, "/nav/gates", "Gate", None, "t_s", "Fate of one measurement in the filter.", (
        number("t_s", "s", "mission time at which it was processed"),
        T_VALID,
        text("sensor", "gps_position, gps_velocity, star_tracker, star_vectors ..."),
        integer("dof", "degrees of freedom"),
        number("nis", "", "normalised innovation squared"),
        number("limit", "", "accepted below it"),
        flag("accepted", "used by the filter"),
        text("note", "what else happened"),
        number("innovation", "", "GPS: [m] or [m/s]; stars: [rad]", (-1,)),
    )),
    Topic(NavHealth, "/nav/health", "NavHealth", None, "t_s", "What the navigation thinks of a sensor.", (
        T_S,
        text("source", "sensor, or axis of one"),
        flag("healthy", "whether it is used again"),
        text("reason", "why it is not"),
    )),
    Topic(Frame, "/star_tracker/frame", "FrameInfo", 10, "t_valid_s", "One picture, without its pixels.", (
        integer("number", "of the frame"),
        number("t_start_s", "s", "mission time at which the shutter opens"),
        T_VALID,
        T_AVAILABLE,
        number("exposure_s", "s", ""),
        number("gain_db", "dB", ""),
        number("line_s", "s", "from the start of one row to that of the next, 0 = global shutter"),
        integer("bits", "of a grey value, which is at most 2^bits - 1"),
    )),
    Topic(StarFix, "/star_tracker/fix", "StarFix", 10, "t_valid_s", "What came out of one frame.", (
        integer("number", "of the frame"),
        T_VALID,
        T_AVAILABLE,
        member("reason", Reason, "why there is no attitude, NONE when there is"),
        vector("q_ic", "",
               "attitude, camera to inertial axes, scalar first; NaN without fix", 4, name="q_ic_wxyz"),
        matrix("P_c", "rad^2", "covariance of the rotation-vector error, camera axes"),
        number("detections.xy_px", "px", "centroids, x and y in turn", (-1, 2)),
        number("detections.flux_dn", "", "grey values above the background, summed", (-1,)),
        integer("detections.n_pixels", "pixels of each detection", (-1,)),
        integer("detections.n_saturated", "saturated pixels of each detection", (-1,)),
        number("detections.P_px", "px^2", "covariance of each centroid", (-1, 2, 2), name="P_px2"),
        integer("hip", "Hipparcos number of each detection, 0 = unidentified", (-1,)),
        number("residual_px", "px", "RMS of the identified stars against the attitude"),
        number("background_dn", "", "mean grey value"),
        number("exposure_s", "s", ""),
        flag("flag_saturated", "picture too bright"),
        flag("flag_no_stars", "fewer objects than an identification needs"),
        member("scan", Scan, "how the objects were searched"),
        integer("stars.hip",
                "Hipparcos numbers of the m stars that may be used by themselves", (-1,), name="star_hip"),
        number("stars.u_c", "",
               "where the nominal camera sees them, unit vectors, m x 3", (-1, 3), name="star_u_c"),
        number("stars.P_u", "rad^2",
               "covariance of each along the cross axes e1 (camera x, made perpendicular to the star) and "
               "e2 = u x e1", (-1, 2, 2), name="star_P_u_rad2"),
        number("stars.u_i", "",
               "where the moving vehicle sees them, inertial axes, m x 3", (-1, 3), name="star_u_i"),
        number("stars.t_seen_s", "s", "when each was seen, from t_valid_s", (-1,), name="star_t_seen_s"),
        matrix("stars.P_omega_c", "rad^2/s^2",
               "covariance of the rate that carried them to t_valid_s, camera axes", name="star_P_omega_c"),
        number("stars.sigma_focal", "", "relative error of the focal length", name="star_sigma_focal"),
        flag("straight",
             "the attitude is that of t_valid_s also where the rate changes, else the mean of the exposure"),
    )),
    Topic(CameraCommand, "/star_tracker/command", "CameraCommand", 10, "t_s", "Asked of the camera next.", (
        T_S,
        number("exposure_s", "s", ""),
        number("gain_db", "dB", ""),
    )),
    Topic(FrameTruth, "/truth/frame", "FrameTruth", 10, "t_valid_s", "What the camera really looked at.", (
        integer("number", "of the frame"),
        T_VALID,
        vector("q_ic", "",
               "true attitude, camera to inertial axes, mounting error included", 4, name="q_ic_wxyz"),
        number("rate", "rad/s", "largest body rate during the exposure"),
        number("sun_angle", "rad", "boresight to the Sun"),
        number("limb_angle", "rad", "boresight to the Earth's limb, positive above"),
        flag("exclusion_met", "both angles outside their exclusion"),
        integer("hip", "Hipparcos numbers of the brightest stars on the detector", (-1,)),
        number("xy_px", "px", "where they are at t_valid_s, x and y in turn", (-1, 2)),
    )),
    Topic(Event, "/events", "Event", None, "t_s", "Something that happened in the mission.", (
        T_S,
        text("name", "what"),
        number("altitude_m", "m", "above the ellipsoid"),
        text("detail", "for people"),
    )),
    Topic(Timing, "/timing", "ComputeTime", None, "t_s", "Measured durations; differ from run to run.", (
        T_S,
        integer("frame_number", "star camera frame; -1 in the closing message"),
        number("chain_s", "s", "star tracker chain of that frame"),
        number("wall_s", "s", "closing message: the whole mission"),
        number("setup_s", "s", "closing message: setting up"),
        number("until_s", "s",
               "closing message: mission time at which looking ended before the mission did; or NaN"),
    )),
    Topic(Mission, "/mission", "Mission", None, "start_s", "Constants of this run.", (
        number("start_s", "s", "mission time of the first record"),
        *EARTH,
        number("launch_latitude", "rad", "of the origin of the launch axes, geodetic"),
        number("launch_longitude", "rad", "likewise"),
        number("launch_height", "m", "likewise, above the ellipsoid"),
        *CAMERA,
        matrix("C_bc", "", "nominal mounting, camera to body axes"),
        vector("sun_i", "", "direction of the Sun from the Earth at t = 0, inertial axes"),
        number("sun_exclusion", "rad", "that the camera must keep from the Sun"),
        number("limb_exclusion", "rad", "that it must keep from the Earth's limb"),
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
        log_kind = {bool: "bool", int: "sfixed32", str: "string"}.get(own, "double")
        fields.append(field(source, column.unit, column.help, log_kind, column.shape))
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
