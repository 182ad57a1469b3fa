"""One flight in the files of many programs: each flies the same way, to what its digits are good for.

The layouts are those of the exports themselves. RocketPy: `FlightDataExporter.export_data`, RocketPy 1.13, a
comment line of names, six digits. OpenRocket: "Export data" of a simulation, its names of flight data with
the unit in brackets, comments about events, three digits. RASAero II: the line of names of the CSV of its
flight simulation, as public readers of such files quote it; feet and seconds. OEM and AEM: CCSDS 502.0-B
and 504.0-B.
"""

import erfa
import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import ITRS, TEME, CartesianRepresentation
from astropy.time import Time
from astropy.utils import iers
from given_flight import ALONG, ORIGIN, at, flown, in_orbit, reckoned, scenario
from made import AEM, EARTH, EPOCH, OEM, Path3, csv, rocket, satellite, write_ccsds

from shefex_nav.environment import ephemeris
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.records import Phase
from shefex_nav.trajectory import ccsds, placing

FOOT = 0.3048
LEVEL = {"format": "csv", "time": "t", "origin": ORIGIN, "attitude": ALONG}
PLACES = {"position": ["x", "y", "z"], "velocity": ["vx", "vy", "vz"]}
QUATERNION = ["qw", "qx", "qy", "qz"]


@pytest.fixture(scope="module")
def path():
    return rocket(until_s=30.0)


class Truth:
    """The made flight in the frames of this program."""

    def __init__(self, path: Path3):
        self.t_s = path.t_s
        self.r_e = path.r_0 + path.r_l @ path.C_el.T
        self.v_e = path.v_l @ path.C_el.T
        pairs = zip(path.t_s, self.r_e, self.v_e, strict=True)
        both = [frames.inertial_from_ecef(EARTH, *one) for one in pairs]
        self.r_i, self.v_i = (np.array([one[k] for one in both]) for k in (0, 1))
        self.C_eb = path.C_el @ np.array([rotation.dcm_from_quat(q) for q in path.q_lb])
        self.C_ib = frames.dcms_ie(EARTH, path.t_s) @ self.C_eb


def differences(flight, truth):
    """Largest differences of position m, velocity m/s and attitude rad at the rows."""
    t, k = flight.trajectory, at(flight.trajectory, truth.t_s)
    C_ib = np.array([rotation.dcm_from_quat(q) for q in t.q_ib[k]])
    cosine = 0.5 * (np.einsum("kij,kij->k", C_ib, truth.C_ib) - 1.0)
    apart = np.linalg.norm(t.r_i[k] - truth.r_i, axis=1), np.linalg.norm(t.v_i[k] - truth.v_i, axis=1)
    return (*(float(one.max()) for one in apart), float(np.arccos(np.clip(cosine, -1.0, 1.0)).max()))


def columns(path, frame):
    """Positions, velocities and C_fb of the made flight in a frame of files."""
    truth = Truth(path)
    if frame == "launch_enu":
        return path.r_l, path.v_l, path.C_el.T @ truth.C_eb
    if frame == "ecef":
        return truth.r_e, truth.v_e, truth.C_eb
    if frame == "inertial":
        return truth.r_i, truth.v_i, truth.C_ib
    C_en = np.array([wgs84.level_axes(one) for one in truth.r_e])
    place = np.array([wgs84.geodetic_from_ecef(one) for one in truth.r_e])
    place[:, :2] = np.degrees(place[:, :2])
    C_nb = C_en.transpose(0, 2, 1) @ truth.C_eb
    return place, np.einsum("kji,kj->ki", C_en, truth.v_e), C_nb


@pytest.mark.parametrize("frame", ["launch_enu", "ecef", "inertial", "geodetic"])
@pytest.mark.parametrize("sense", ["body_to_frame", "frame_to_body"])
def test_csv_in_every_frame_flies_the_same_way(path, tmp_path, frame, sense):
    r, v, C_fb = columns(path, frame)
    q = np.array([rotation.quat_from_dcm(np.ascontiguousarray(C)) for C in C_fb])
    q = q if sense == "body_to_frame" else q * [1.0, -1.0, -1.0, -1.0]
    names = ("t", "x", "y", "z", "vx", "vy", "vz", *QUATERNION)
    csv(tmp_path / "flight.csv", names, (path.t_s, r, v, q), 11)
    moving = "ned" if frame == "geodetic" else frame
    told = {"position_frame": frame, "velocity_frame": moving}
    turned = {"quaternion": QUATERNION, "sense": sense, "frame": moving}
    flight, _ = flown(LEVEL | PLACES | told | {"file": tmp_path / "flight.csv", "attitude": turned})
    r_off, v_off, q_off = differences(flight, Truth(path))
    assert r_off < 1e-4 and v_off < 1e-3 and q_off < 1e-6


def test_angles_units_axes_and_a_clock_of_the_file(path, tmp_path):
    """Kilometres, milliseconds from another instant on, a body with z to the nose."""
    r, v, _ = columns(path, "geodetic")
    C_nb = columns(path, "geodetic")[2]
    C_nf = np.stack([C_nb[:, :, 1], C_nb[:, :, 2], C_nb[:, :, 0]], axis=2)  # file x right, y down, z forward
    angles = np.array([euler.euler_from_dcm(np.ascontiguousarray(C)) for C in C_nf])
    place = np.column_stack([np.radians(r[:, :2]), r[:, 2] / 1e3])
    v_enu = np.column_stack([v[:, 1], v[:, 0], -v[:, 2]]) / 1e3
    names = ("t", "x", "y", "z", "vx", "vy", "vz", "roll", "pitch", "heading")
    clock_ms = 1e3 * (path.t_s + 12.5)
    csv(tmp_path / "flight.csv", names, (clock_ms, place, v_enu, np.degrees(angles)), 12)
    told = {
        "file": tmp_path / "flight.csv", "format": "csv", "time": "t", "time_unit": "ms",
        "lift_off": "12.5 s", "position_frame": "geodetic", "position_unit": "km", "angle_unit": "rad",
        "velocity_frame": "enu", "velocity_unit": "km/s",
        "attitude": {"euler": ["roll", "pitch", "heading"], "axes": ["z", "x", "y"]},
    }  # fmt: skip
    flight, _ = flown(PLACES | told)
    r_off, v_off, q_off = differences(flight, Truth(path))
    assert r_off < 1e-4 and v_off < 1e-3 and q_off < 1e-6


def test_positions_alone(path, tmp_path):
    csv(tmp_path / "flight.csv", ("t", "x", "y", "z"), (path.t_s, path.r_l), 9)
    told = LEVEL | {"file": tmp_path / "flight.csv", "position": ["x", "y", "z"]}
    flight, _ = flown(told | {"position_frame": "launch_enu"})
    truth = Truth(path)
    r_off, v_off, _ = differences(flight, truth)
    assert r_off < 0.01 and v_off < 1.0
    coasts = path.t_s > 12.0
    k = at(flight.trajectory, path.t_s[coasts])
    assert np.abs(flight.trajectory.v_i[k] - truth.v_i[coasts]).max() < 1e-3


def test_accelerations_are_taken(path, tmp_path):
    """With them thrust that sets in between two coarse rows is better known than without."""
    few = slice(None, None, 2)
    names = ("t", "x", "y", "z", "vx", "vy", "vz", "ax", "ay", "az")
    csv(tmp_path / "flight.csv", names, (path.t_s[few], path.r_l[few], path.v_l[few], path.a_l[few]), 9)
    told = LEVEL | PLACES | {"file": tmp_path / "flight.csv", "velocity_frame": "launch_enu"}
    told |= {"position_frame": "launch_enu"}
    truth, off = Truth(rocket(30.0, 0.01)), []
    for more in ({}, {"acceleration": ["ax", "ay", "az"]}):
        t = flown(told | more)[0].trajectory
        apart = t.v_i[at(t, truth.t_s)] - truth.v_i
        off.append(np.sqrt(np.mean(apart**2)))
    assert off[1] < 0.6 * off[0] < 0.003


def nose_and_roll(path):
    """C_lb in the body of RocketPy, z to the nose: x and y are our right and down."""
    C_lb = np.array([rotation.dcm_from_quat(q) for q in path.q_lb])
    C_lf = np.stack([C_lb[:, :, 1], C_lb[:, :, 2], C_lb[:, :, 0]], axis=2)
    return np.array([rotation.quat_from_dcm(np.ascontiguousarray(C)) for C in C_lf])


def test_layout_of_rocketpy(path, tmp_path):
    names = [
        "Time (s)",
        "X (m)",
        "Y (m)",
        "Z (m)",
        "Vx (m/s)",
        "Vy (m/s)",
        "Vz (m/s)",
        "e0",
        "e1",
        "e2",
        "e3",
    ]
    r_l = path.r_l + np.array([0.0, 0.0, 10.0])  # Z is above the sea
    csv(tmp_path / "rp.csv", ["# " + names[0], *names[1:]], (path.t_s, r_l, path.v_l, nose_and_roll(path)), 6)
    origin = ORIGIN | {"height": "0 m"}
    flight, _ = flown({"file": tmp_path / "rp.csv", "format": "rocketpy", "origin": origin})
    r_off, v_off, q_off = differences(flight, Truth(path))
    assert r_off < 0.01 and v_off < 0.01 and q_off < 1e-5


def test_layout_of_openrocket(path, tmp_path):
    names = ("# Time (s)", "Altitude (m)", "Vertical velocity (m/s)", "Vertical acceleration (m/s²)",
             "Position East of launch (m)", "Position North of launch (m)", "Roll rate (°/s)")  # fmt: skip
    zero = np.zeros(len(path.t_s))
    values = (path.t_s, path.r_l[:, 2], path.v_l[:, 2], path.a_l[:, 2], path.r_l[:, 0], path.r_l[:, 1], zero)
    head = "# Simulation 1 (Up to date)\n# 301 data points written for 6 variables.\n"
    csv(tmp_path / "or.csv", names, values, 3, head)
    lines = (tmp_path / "or.csv").read_text().splitlines()
    lines.insert(40, "# Event APOGEE occurred at t=43.7 seconds")
    (tmp_path / "or.csv").write_text("\n".join(lines))
    told = {"file": tmp_path / "or.csv", "format": "openrocket", "origin": ORIGIN, "attitude": ALONG}
    flight, _ = flown(told)
    truth = Truth(path)
    r_off, _, _ = differences(flight, truth)
    t, coasts = flight.trajectory, path.t_s > 12.0
    k = at(t, path.t_s[coasts])
    assert r_off < 0.3
    assert np.abs(t.v_i[k] - truth.v_i[coasts]).max() < 0.1
    assert reckoned(scenario(told))[0] < 0.05


RASAERO = (
    "Time (sec),Stage,Stage Time (sec),Mach Number,Angle of Attack (deg),CD,CL,Thrust (lb),Weight (lb),"
    "Drag (lb),Lift (lb),CG (in),CP (in),Stability Margin (cal),Accel (ft/sec^2),Accel-V (ft/sec^2),"
    "Accel-H (ft/sec^2),Velocity (ft/sec),Vel-V (ft/sec),Vel-H (ft/sec),Pitch Attitude (deg),"
    "Flight Path Angle (deg),Altitude (ft),Distance (ft)"
).split(",")


def test_layout_of_rasaero(path, tmp_path):
    azimuth, zero = np.radians(352.0), np.zeros(len(path.t_s))
    along = np.array([np.sin(azimuth), np.cos(azimuth), 0.0])
    values = dict.fromkeys(RASAERO, zero)
    values |= {"Time (sec)": path.t_s, "Altitude (ft)": path.r_l[:, 2] / FOOT, "Stage": zero + 1.0}
    values |= {"Distance (ft)": path.r_l @ along / FOOT, "Vel-V (ft/sec)": path.v_l[:, 2] / FOOT}
    values["Vel-H (ft/sec)"] = path.v_l @ along / FOOT
    csv(tmp_path / "ras.csv", RASAERO, tuple(values.values()), 5)
    told = {"file": tmp_path / "ras.csv", "format": "rasaero", "origin": ORIGIN, "attitude": ALONG}
    flight, _ = flown(told | {"azimuth": "352 deg"})
    t, truth = flight.trajectory, Truth(path)
    k = at(t, path.t_s)
    aside = np.cross(along, [0.0, 0.0, 1.0])  # where RASAero's flight plane has nothing
    off_l = np.einsum(
        "kij,kj->ki", frames.dcms_ie(EARTH, path.t_s) @ path.C_el, np.outer(path.r_l @ aside, aside)
    )
    assert np.abs(t.r_i[k] - (truth.r_i - off_l)).max() < 0.01
    assert reckoned(scenario(told | {"azimuth": "352 deg"}))[0] < 0.05
    assert {Phase.PAD, Phase.BOOST, Phase.COAST} == set(t.phase)


def test_along_the_velocity_it_rolls_as_told(path, tmp_path):
    csv(tmp_path / "flight.csv", ("t", "x", "y", "z", "vx", "vy", "vz"), (path.t_s, path.r_l, path.v_l), 9)
    told = LEVEL | PLACES | {"file": tmp_path / "flight.csv", "velocity_frame": "launch_enu"}
    told |= {"position_frame": "launch_enu"}
    t = flown(told | {"attitude": ALONG | {"roll_rate": "1.5 Hz"}})[0].trajectory
    flies = t.t_s > 2.0
    assert np.degrees(t.angle_of_attack[flies].max()) < 0.02
    assert np.allclose(t.omega_ib_b[flies, 0], 2.0 * np.pi * 1.5, atol=1e-2)
    assert np.abs(t.omega_ib_b[t.t_s < -0.1]).max() < 1e-4


# CCSDS


def test_the_committed_pair_of_messages_flies():
    orbit = satellite()
    flight, earth = in_orbit({"file": OEM, "format": "oem", "attitude": {"aem": str(AEM)}})
    t, k = flight.trajectory, at(flight.trajectory, orbit.t_s)
    assert np.linalg.norm(t.r_i[k] - orbit.r_i, axis=1).max() < 1e-4
    assert np.linalg.norm(t.v_i[k] - orbit.v_i, axis=1).max() < 1e-5
    off = rotation.rotvec_between(t.q_ib[k], orbit.q_ib)
    assert np.linalg.norm(off, axis=1).max() < 1e-9
    assert np.abs(t.f_b).max() < 2e-3  # it falls: forces are what interpolation over 10 s leaves
    assert np.median(np.linalg.norm(t.f_b, axis=1)) < 1e-4
    assert set(t.phase) == {Phase.ORBIT} and earth.rate == EARTH.rate


def test_frames_of_messages(tmp_path):
    """ICRF, EME2000, ITRF and TEME; the last against astropy, whose own table has UT1 of that day."""
    orbit = satellite(100.0)
    told = {"file": tmp_path / "a.oem", "format": "oem", "attitude": {"aem": str(tmp_path / "a.aem")}}
    for frame, C in (("ICRF", np.eye(3)), ("EME2000", None)):
        write_ccsds(tmp_path / "a.oem", tmp_path / "a.aem", orbit, C, frame)
        t = in_orbit(told)[0].trajectory
        assert np.linalg.norm(t.r_i[at(t, orbit.t_s)] - orbit.r_i, axis=1).max() < 1e-4
    fixed = [
        frames.ecef_from_inertial(EARTH, *one) for one in zip(orbit.t_s, orbit.r_i, orbit.v_i, strict=True)
    ]
    r_e, v_e = (np.array([one[k] for one in fixed]) for k in (0, 1))
    write_ccsds(
        tmp_path / "a.oem", tmp_path / "a.aem", orbit._replace(r_i=r_e, v_i=v_e), np.eye(3), "ITRF2008"
    )
    told["attitude"] = ALONG
    t = in_orbit(told)[0].trajectory
    assert np.linalg.norm(t.r_i[at(t, orbit.t_s)] - orbit.r_i, axis=1).max() < 1e-4
    assert np.linalg.norm(t.v_i[at(t, orbit.t_s)] - orbit.v_i, axis=1).max() < 1e-5
    with iers.conf.set_temp("auto_download", False):
        when = Time(EPOCH) + orbit.t_s * u.s
        there = ITRS(CartesianRepresentation(*(r_e.T * u.m)), obstime=when).transform_to(TEME(obstime=when))
    r_teme = there.cartesian.xyz.to_value(u.m).T
    v_teme = np.gradient(r_teme, orbit.t_s, axis=0, edge_order=2)
    moved = orbit._replace(r_i=r_teme, v_i=v_teme)
    write_ccsds(tmp_path / "a.oem", tmp_path / "a.aem", moved, np.eye(3), "TEME")
    t = in_orbit(told)[0].trajectory
    assert np.linalg.norm(t.r_i[at(t, orbit.t_s)] - orbit.r_i, axis=1).max() < 0.5


@pytest.mark.parametrize("utc", ["2012-06-22T19:18:00", "2012-06-30T18:00:00", "2016-12-31T23:00:00"])
def test_true_equator_and_mean_equinox(utc):
    """Two of these days have a leap second. TEME lies by the equation of the equinoxes from the true equinox.

    IAU 1976 precession and IAU 1980 nutation, without UT1 at all; they differ from those of 2006 by 0.06".
    """
    ut1_minus_utc, t_s = -0.4, np.array([0.0, 100.0])
    earth = ephemeris.earth_rotation(utc, ut1_minus_utc, 0.0, 0.0)
    here = placing.place(earth, t_s)
    found = ccsds._axes_in_i(here, t_s, ccsds.TEME, ccsds.Epoch(utc, ut1_minus_utc))
    time = Time(utc, scale="utc").tt
    equinoxes = rotation.dcm_from_rotvec(np.array([0.0, 0.0, -erfa.eqeq94(time.jd1, time.jd2)]))
    C_fi = equinoxes @ erfa.pnm80(time.jd1, time.jd2)
    assert np.abs(found @ C_fi - np.eye(3)).max() < 4e-7


@pytest.mark.parametrize("system, ahead_s", [("TAI", 35.0), ("GPS", 16.0), ("TT", 67.184)])
def test_time_systems_of_messages(tmp_path, system, ahead_s):
    """On 22 June 2012 TAI - UTC was 34 s until the leap second of 30 June."""
    orbit = satellite(100.0)
    ahead_s -= 1.0
    write_ccsds(
        tmp_path / "a.oem", tmp_path / "a.aem", orbit._replace(t_s=orbit.t_s + ahead_s), np.eye(3), "GCRF"
    )
    for name in ("a.oem", "a.aem"):
        text = (tmp_path / name).read_text().replace("TIME_SYSTEM = UTC", f"TIME_SYSTEM = {system}")
        (tmp_path / name).write_text(text)
    told = {"file": tmp_path / "a.oem", "format": "oem", "attitude": {"aem": str(tmp_path / "a.aem")}}
    t = in_orbit(told)[0].trajectory
    assert np.linalg.norm(t.r_i[at(t, orbit.t_s)] - orbit.r_i, axis=1).max() < 0.01


def test_a_quaternion_the_other_way_with_the_scalar_first(tmp_path):
    """ATTITUDE_DIR = B2A, QUATERNION_TYPE = FIRST, and the body as frame A."""
    orbit = satellite(100.0)
    write_ccsds(tmp_path / "a.oem", tmp_path / "a.aem", orbit, np.eye(3), "GCRF")
    lines = (tmp_path / "a.aem").read_text().splitlines()
    begin = lines.index("DATA_START") + 1
    for k in range(begin, len(lines) - 1):
        when, x, y, z, w = lines[k].split()
        lines[k] = f"{when} {w} {-float(x):.12f} {-float(y):.12f} {-float(z):.12f}"
    text = "\n".join(lines).replace("A2B", "B2A").replace("= LAST", "= FIRST")
    told = {"file": tmp_path / "a.oem", "format": "oem", "attitude": {"aem": str(tmp_path / "a.aem")}}
    swapped = text.replace("FRAME_A = GCRF", "FRAME_A = SC_BODY_1").replace("B = SC_BODY_1", "B = GCRF")
    for one in (text, swapped.replace("B2A", "A2B")):
        (tmp_path / "a.aem").write_text(one)
        t = in_orbit(told)[0].trajectory
        off = rotation.rotvec_between(t.q_ib[at(t, orbit.t_s)], orbit.q_ib)
        assert np.linalg.norm(off, axis=1).max() < 1e-9
