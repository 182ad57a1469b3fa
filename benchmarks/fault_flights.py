"""Flights with faults for `faults.py`: what a filter said of itself, beside the truth.

Star fixes are those of rendered frames, flown with the scenario, or those of the default mission that
`consistency.py` has kept: then the faults of the star tracker are put into them.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from missions import SCENARIOS

REQUIRED = np.radians(0.17)
WRONG = np.radians(0.3)  # a star fix that is off by more is a wrong one; the least of them is off by 0.5 deg
MADE_FOR = {"scenario": "shefex2_andoya.yaml", "set": []}  # whose star fixes `--stars` must hold


class Flight(NamedTuple):
    """Ten times a second: truth minus estimate and what the solution said of it; and what was said at all."""

    t_s: np.ndarray  # (n,)
    error: np.ndarray  # (n, 9) m, m/s, rad: axes of the Earth, attitude in body axes
    sigma: np.ndarray  # (n, 9)
    protection_b: np.ndarray  # (n, 3) rad
    doubt: np.ndarray  # (n,)
    aided: np.ndarray  # (n,) bool, a star fix has been used
    gates: list  # GateResult
    health: list  # NavHealth
    wrong_s: set  # times of validity of wrong star fixes
    entry_s: float

    def during(self, begin_s, end_s):
        return (self.t_s >= begin_s) & (self.t_s < end_s)

    def used(self, sensor, begin_s=-np.inf, end_s=np.inf):
        """Times of validity of the measurements that were used."""
        of_sensor = [gate for gate in self.gates if gate.sensor == sensor and gate.accepted]
        return [gate.t_valid_s for gate in of_sensor if begin_s <= gate.t_valid_s < end_s]

    def attitude_at_entry(self):
        """Largest error of an axis in deg, whether it meets the requirement and may be used."""
        k = int(np.argmin(np.abs(self.t_s - self.entry_s)))
        error = np.abs(self.error[k, 6:]).max()
        return np.degrees(error), bool(error < REQUIRED and self.doubt[k] == 0)

    def rms_attitude(self, begin_s, end_s):
        """deg, of the angle."""
        angles = self.error[self.during(begin_s, end_s), 6:]
        return np.degrees(np.sqrt((angles**2).sum(axis=1).mean()))


def fly(job):
    """One flight; Flight."""
    from shefex_nav import prepare
    from shefex_nav.scenario import load

    scenario = load.load(SCENARIOS / f"{job['scenario']}.yaml", job["overrides"])
    world = prepare.build_world(scenario, job["seed"])
    follow = with_kept_stars if job["stars"] else with_rendered_stars
    return follow(scenario, world, job)


def with_rendered_stars(scenario, world, job):
    """The whole chain."""
    from shefex_nav import simulate

    log = Log(world)
    for record in simulate.route(world, scenario, job["seed"], until_s=job["until_s"]):
        log.take(record)
    return log.flight()


def with_kept_stars(scenario, world, job):
    """The filter alone, over star fixes that are kept; the faults of the star tracker are put into them."""
    from shefex_nav.onboard import navigator
    from shefex_nav.onboard.driving import Recorded, drive
    from shefex_nav.records import StarFix
    from shefex_nav.verify import flown
    from shefex_nav.world import faults, imu, noise

    line = faults.StarLine(world.faults.stars, noise.generator(job["seed"], "faults"))
    white = [(one.start, one.end) for one in world.faults.star_tracker if one.fault == "blinded"]
    if scenario.navigation.stars != "attitude":
        raise ValueError("kept fixes have no single stars: navigation.stars must be attitude")
    fixes = flown.load(Path(job["stars"]) / f"fixes-{job['seed']:04d}.npz", MADE_FOR)
    seen = [fix for fix in fixes if not any(begin <= fix.t_valid_s < end for begin, end in white)]
    seen = [fix for fix in seen if fix.t_valid_s not in job.get("without", ())]
    lists = (
        sorted(records, key=lambda one: one.t_available_s)
        for records in (world.gps_fixes + world.gps_ranges, map(line.fix, seen))
    )
    software, log = navigator.start(world.computer.nav, world.alignment, world.earth), Log(world)
    blocks = imu.stacked(world.imu)
    ticks = int(np.searchsorted(blocks.t_valid_s, job["until_s"], side="right"))
    for _, arrived, outputs in drive(software, blocks, Recorded(blocks.t_valid_s, *lists), ticks):
        for record in [*(one for one in arrived if isinstance(one, StarFix)), *outputs]:
            log.take(record)
    return log.flight()


class Log:
    """Keeps of the records of a flight what is needed."""

    def __init__(self, world):
        self.world, self.rows, self.gates, self.health, self.wrong_s = world, [], [], [], set()
        self.start_s = world.flight.trajectory.t_s[0]

    def take(self, record):
        from shefex_nav.geometry import rotation
        from shefex_nav.records import GateResult, NavHealth, NavSolution, Reason, StarFix

        truth = self.world.flight.trajectory
        if isinstance(record, GateResult):
            self.gates.append(record)
        elif isinstance(record, NavHealth):
            self.health.append(record)
        elif isinstance(record, StarFix) and record.reason == Reason.NONE:
            k = int(np.argmin(np.abs(truth.t_s - record.t_valid_s)))
            q_ic = rotation.quat_multiply(truth.q_ib[k], self.world.camera.q_bc)
            off = rotation.rotvec_between(q_ic, record.q_ic)
            # within half a sample of the IMU a vehicle that turns slowly enough for stars moves by 0.02 deg
            if np.linalg.norm(off) > WRONG:
                self.wrong_s.add(record.t_valid_s)
        elif isinstance(record, NavSolution) and round((record.t_s - self.start_s) * 100) % 10 == 0:
            self.rows.append(self._row(record, rotation))

    def _row(self, out, rotation):
        truth = self.world.flight.trajectory
        k = int(np.searchsorted(truth.t_s, out.t_s - 1e-6))
        turned = rotation.rotvec_between(out.q_ib, truth.q_ib[k])
        r_e, v_e = self._in_e(out.t_s, truth.r_i[k], truth.v_i[k])
        error = np.concatenate([r_e - out.r_e, v_e - out.v_e, turned])
        sigma = np.concatenate([out.sigma_r_e, out.sigma_v_e, out.sigma_theta_b])
        return out.t_s, error, sigma, out.protection_attitude, out.doubt_attitude, out.star_aided

    def _in_e(self, t_s, r_i, v_i):
        from shefex_nav.geometry import frames

        return frames.ecef_from_inertial(self.world.earth, t_s, r_i, v_i)

    def flight(self):
        columns = [np.array(column) for column in zip(*self.rows, strict=True)]
        entry_s = next(event.t_s for event in self.world.flight.events if event.name == "entry")
        return Flight(*columns, self.gates, self.health, self.wrong_s, entry_s)
