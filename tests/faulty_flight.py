"""A scenario flown with its sensors and its filter, but without pictures, for the tests of faults.

Star fixes are made from the truth, with the covariance that the chain's have in the default mission, whenever
the star camera sees stars there. So a flight takes seconds, and faults do to it what the scenario says.
"""

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from shefex_nav import prepare, records, simulate
from shefex_nav.geometry import rotation
from shefex_nav.onboard.navigation import covariance, fusion, protected, solution
from shefex_nav.records import StarFix
from shefex_nav.scenario import load
from shefex_nav.world import faults, imu, noise

SCENARIOS = Path(__file__).parent.parent / "scenarios"
ARCSEC = np.pi / 648000.0
P_C = np.diag([1.2 * ARCSEC, 1.1 * ARCSEC, 12.0 * ARCSEC]) ** 2  # medians over the default mission
STARS_S = 247.5, 384.9  # between them frames are solved
SLOWEST = np.radians(2.0)  # rad/s, not faster
REQUIRED = np.radians(0.17)


class Flown(NamedTuple):
    """Ten times a second: truth minus estimate, its standard deviations, and what the solution said."""

    t_s: np.ndarray  # (n,)
    error: np.ndarray  # (n, 9) m, m/s, rad: inertial axes, attitude in body axes
    sigma: np.ndarray  # (n, 9)
    protection_b: np.ndarray  # (n, 3) rad
    doubt: np.ndarray  # (n,) Doubt about the attitude
    level: np.ndarray  # (n, 4) m, m/s: protection level of position and velocity, horizontal, vertical
    doubts: np.ndarray  # (n, 2) Doubt about them
    level_error: np.ndarray  # (n, 4) their errors in the same axes
    gates: list  # GateResult
    health: list  # NavHealth
    world: object

    def at(self, t_s):
        """Index of a time."""
        return int(np.argmin(np.abs(self.t_s - t_s)))

    def during(self, begin_s, end_s):
        return (self.t_s >= begin_s) & (self.t_s < end_s)

    @property
    def entry_s(self):
        """Mission time of the descent through 100 km."""
        return next(event.t_s for event in self.world.flight.events if event.name == "entry")

    def used(self, sensor, begin_s=-np.inf, end_s=np.inf):
        """Times of validity of the measurements of a sensor that were used."""
        return [
            gate.t_valid_s
            for gate in self.gates
            if gate.sensor == sensor and gate.accepted and begin_s <= gate.t_valid_s < end_s
        ]

    def noticed(self, source):
        """(when, reason) of every change in what was thought of a source; empty reason: healthy."""
        return [(record.t_s, record.reason) for record in self.health if record.source == source]


@cache
def fly(name, *overrides, seed=1, until_s=np.inf):
    """Fly a scenario of the package."""
    scenario = load.load(SCENARIOS / f"{name}.yaml", overrides)
    world = prepare.build_world(scenario, seed)
    line = faults.StarLine(world.faults.star_tracker, noise.generator(seed, "faults"))
    stars = [line.fix(fix) for fix in star_fixes(world, seed) if not blinded(world.faults.star_tracker, fix)][
        ::-1
    ]
    gps = sorted(world.gps_fixes, key=lambda fix: fix.t_available_s, reverse=True)
    nav = fusion.start(world.computer.nav, world.alignment, world.earth)
    rows, gates, health = [], [], []
    for n, block in enumerate(records.rows(imu.stacked(world.imu)), 1):
        now_s = block.t_valid_s
        if now_s > until_s:
            break
        fusion.advance(nav, block)
        arrivals = [("gps", fix) for fix in simulate.due(gps, now_s)]
        arrivals += [("star_tracker", fix) for fix in simulate.due(stars, now_s)]
        if arrivals:
            gates += fusion.fuse(nav, arrivals)
        health += nav.watch.changes()
        if n % 10 == 0:
            rows.append(_row(nav, world.flight.trajectory, 4 * n))
    columns = [np.array(column) for column in zip(*rows, strict=True)]
    return Flown(*columns, gates, health, world)


def _row(nav, truth, k):
    out = solution.solution(nav)
    attitude = rotation.rotvec_between(out.q_ib, truth.q_ib[k])
    error = np.concatenate([truth.r_i[k] - out.r_i, truth.v_i[k] - out.v_i, attitude])
    sigma = np.sqrt(np.diag(covariance.reported(nav))[:9])
    level = np.concatenate([out.protection_position, out.protection_velocity])
    doubts = np.array([out.doubt_position, out.doubt_velocity])
    axes = protected.level_axes(nav.earth, out.t_s, nav.history.x)
    r, v = axes[:3] @ error[:3], axes[:3] @ (error[3:6] - np.cross(axes[3], error[:3]))
    in_axes = np.array([np.hypot(r[0], r[1]), abs(r[2]), np.hypot(v[0], v[1]), abs(v[2])])
    return out.t_s, error, sigma, out.protection_attitude, out.doubt_attitude, level, doubts, in_axes


def star_fixes(world, seed):
    """Fixes as the chain would give them: StarFix, by time."""
    truth, rng, found = world.flight.trajectory, np.random.default_rng([seed, 77]), []
    for number, t_s in enumerate(np.arange(*STARS_S, 0.1)):
        k = int(np.searchsorted(truth.t_s, t_s - 1e-6))
        error = np.sqrt(np.diag(P_C)) * rng.standard_normal(3)
        if np.linalg.norm(truth.omega_ib_b[k]) > SLOWEST:
            continue
        q_ic = rotation.quat_multiply(truth.q_ib[k], world.camera.q_bc)
        q_ic = rotation.quat_multiply(q_ic, rotation.quat_from_rotvec(error))
        t_valid_s = float(truth.t_s[k])
        found.append(
            StarFix(
                number, t_valid_s, t_valid_s + 0.06, 0, q_ic, P_C, None, None, 0.1, 9.0, 0.05, False, False
            )
        )
    return found


def blinded(star_faults, fix):
    """Whether a white picture takes the place of a fix."""
    return any(f.fault == "blinded" and f.start <= fix.t_valid_s < f.end for f in star_faults)
