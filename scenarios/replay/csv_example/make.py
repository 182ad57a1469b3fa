"""Makes the data of csv_example.yaml with the simulator: `python scenarios/replay/csv_example/make.py`.

A student rocket without spin, launched at 70 deg, from 15 s before lift-off to 20 s after it. Written is
what other people's loggers write: milliseconds, degrees, an IMU whose y points left and z up, rates.
"""

from pathlib import Path

import numpy as np

from shefex_nav import prepare
from shefex_nav.geometry import euler, frames, rotation, wgs84
from shefex_nav.scenario import load
from shefex_nav.scenario.quantity import STANDARD_GRAVITY

HERE = Path(__file__).parent
SEED = 1
UNTIL_S = 20.0  # after lift-off
IMU_STEP, TRUTH_STEP = 2, 40  # of the 400 samples a second: 200 Hz and 10 Hz
FLIGHT = (
    "mission.start=-15 s",
    "wind=none",
    "launch.elevation=70 deg",
    "vehicle.stages.Orion.aerodynamics.fin_cant=0 deg",
    "vehicle.yo_yo=null",
    "imu.vibration.boost=[0.05 gee]",
)


def local(earth, t_s, r_i, v_i):
    """Latitude, longitude [deg], height [m], and velocity east, north, up [m/s]; C_ne."""
    r_e, v_e = frames.ecef_from_inertial(earth, t_s, r_i, v_i)
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    C_ne = wgs84.dcm_en(latitude, longitude).T
    north, east, down = C_ne @ v_e
    return (np.degrees(latitude), np.degrees(longitude), height), (east, north, -down), C_ne


def imu_rows(data, until):
    """Milliseconds, deg/s and gee, forward, left, up: means over pairs of samples."""
    turn = np.add.reduceat(data.dtheta_b[1:until], np.arange(0, until - 1, IMU_STEP))
    gain = np.add.reduceat(data.dv_b[1:until], np.arange(0, until - 1, IMU_STEP))
    ends_s = data.t_s[IMU_STEP:until:IMU_STEP]
    step_s, flip = IMU_STEP * (data.t_s[1] - data.t_s[0]), np.array([1.0, -1.0, -1.0])
    for t_s, angle, velocity in zip(ends_s - data.t_s[0], turn * flip, gain * flip, strict=True):
        rates = [f"{x:.5f}" for x in np.degrees(angle) / step_s]
        yield [f"{1e3 * t_s:.1f}", *rates, *(f"{x:.6f}" for x in velocity / step_s / STANDARD_GRAVITY)]


def gnss_rows(fixes, start_s):
    """Milliseconds, place, velocity east, north, up, sigmas north, east, down, flag."""
    for fix in fixes:
        if fix.t_valid_s > UNTIL_S:
            return
        row = ["0"] * 12
        if fix.valid:
            latitude, longitude, height = wgs84.geodetic_from_ecef(fix.r_ea_e)
            C_ne = wgs84.dcm_en(latitude, longitude).T
            north, east, down = C_ne @ fix.v_ea_e
            sigmas = [np.sqrt(np.diag(C_ne @ R @ C_ne.T)) for R in (fix.R_r_e, fix.R_v_e)]
            row = [f"{np.degrees(latitude):.8f}", f"{np.degrees(longitude):.8f}", f"{height:.3f}"]
            row += [f"{x:.4f}" for x in (east, north, -down)] + [f"{x:.3f}" for x in np.ravel(sigmas)]
        yield [f"{1e3 * (fix.t_valid_s - start_s):.1f}", *row, "1" if fix.valid else "0"]


def truth_rows(flown, earth, until):
    """Milliseconds, place, velocity east, north, up, roll, pitch, heading."""
    for k in range(0, until, TRUTH_STEP):
        t_s = flown.t_s[k]
        place, velocity, C_ne = local(earth, t_s, flown.r_i[k], flown.v_i[k])
        C_nb = C_ne @ frames.dcm_ie(earth, t_s).T @ rotation.dcm_from_quat(flown.q_ib[k])
        angles = [f"{np.degrees(angle):.5f}" for angle in euler.euler_from_dcm(C_nb)]
        row = [f"{place[0]:.9f}", f"{place[1]:.9f}", f"{place[2]:.4f}", *(f"{x:.5f}" for x in velocity)]
        yield [f"{1e3 * (t_s - flown.t_s[0]):.1f}", *row, *angles]


def write(name, columns, rows):
    """One CSV."""
    lines = [columns, *(",".join(row) for row in rows)]
    (HERE / name).write_text("\n".join(lines) + "\n", encoding="utf-8")


def main():
    """Fly and write."""
    scenario = load.load(HERE.parents[1] / "rexus_like.yaml", FLIGHT)
    world = prepare.build_world(scenario, SEED)
    flown, earth = world.flight.trajectory, world.earth
    until = int(np.searchsorted(flown.t_s, UNTIL_S)) // TRUTH_STEP * TRUTH_STEP + 1
    write("imu.csv", "t_ms,wx,wy,wz,fx,fy,fz", imu_rows(world.imu, until))
    columns = "t_ms,latitude,longitude,height,ve,vn,vu,sn,se,sd,svn,sve,svd,fix"
    write("gnss.csv", columns, gnss_rows(world.gps_fixes, flown.t_s[0]))
    columns = "t_ms,latitude,longitude,height,ve,vn,vu,roll,pitch,heading"
    write("truth.csv", columns, truth_rows(flown, earth, until))


if __name__ == "__main__":
    main()
