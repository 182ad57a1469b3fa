"""Short flights with software of a user's own, and how their records are compared."""

import shutil

import numpy as np

from shefex_nav import prepare, simulate
from shefex_nav.commands.new import TEMPLATES
from shefex_nav.records import ComputeTime
from shefex_nav.scenario.load import load

CLASS = "shefex_nav.software.built_in:BuiltIn"
STATISTICAL = "star_tracker.frames=statistical"
RECKONING = """
from shefex_nav.geometry import rotation
from shefex_nav.software import Estimate


class Reckoning:
    def start(self, alignment, mission):
        self.r, self.v, self.q = alignment.r_i, alignment.v_i, alignment.q_ib
        self.ticks, self.mission = 0, mission

    def step(self, imu, arrived):
        self.ticks += 1
        turn = rotation.quat_from_rotvec(imu.dtheta_b.sum(axis=0))
        self.q = rotation.quat_normalise(rotation.quat_multiply(self.q, turn))
        HERE
        return Estimate(self.r, self.v, self.q)
"""


def reckoning(folder, here="pass"):
    """A file with navigation software that turns with the gyros and stays where it is. here : a line of it"""
    path = folder / "own.py"
    path.write_text(RECKONING.replace("HERE", here))
    return path


def template(name, folder):
    """A copy of what `shefex-nav new` writes."""
    return shutil.copy(TEMPLATES / name, folder / f"my_{name}")


def flown(scenario, *overrides, until_s=np.inf, seed=1):
    """Records of a flight but for measured times."""
    scenario = prepare.settled(load(scenario, overrides, trust=True))
    world = prepare.build_world(scenario, seed)
    records = simulate.route(world, scenario, seed, until_s=until_s)
    return [one for one in records if not isinstance(one, ComputeTime)]


def same(one, other):
    """Whether two records, or lists of them, hold the same to the last bit."""
    if isinstance(one, np.ndarray):
        return np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    if isinstance(one, tuple | list):
        pairs = zip(one, other, strict=True)
        return type(one) is type(other) and len(one) == len(other) and all(same(*pair) for pair in pairs)
    return one == other or (one != one and other != other)
