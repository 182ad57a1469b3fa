"""Runs of a mission for statistics: flown once with rendered frames, then the filter alone as often as
needed.

The star fixes of a run are kept in a file; IMU, GPS and truth are made again from the seed. So the filter
can be run again with another configuration, over the same measurements, in seconds. The configuration that
was flown gives the very same result that it gave in flight.
"""

import json
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from shefex_nav import files, prepare, simulate
from shefex_nav.clock import SAME_S, TICK_HZ
from shefex_nav.errors import UserError
from shefex_nav.geometry.rotation import rotvec_between
from shefex_nav.onboard.driving import Recorded, drive
from shefex_nav.onboard.navigation import covariance, fusion
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.quantity import ATTITUDE, fix_of
from shefex_nav.onboard.navigation.state import ATT, BA, BG, POS, VEL
from shefex_nav.onboard.navigator import NOTHING, Columns, Navigator
from shefex_nav.records import Detections, GateResult, Reason, StarFix
from shefex_nav.verify import linear
from shefex_nav.world import imu

BLOCKS = {"attitude": ATT, "velocity": VEL, "position": POS, "gyro_bias": BG, "accel_bias": BA}
PHASES = ("boost", "coast without stars", "star window", "entry", "descent")
PAD = -1
RISE = 1e3  # m above start and end, from which on there is an apogee
N_CORE = 15
EPOCH_TICKS = 50  # between two epochs of the statistics


class FlownError(UserError):
    """A run that the statistics cannot use, or star fixes that are those of others."""


class Run(NamedTuple):
    """Errors of one run at m epochs, in the order of the filter's first fifteen errors."""

    seed: int
    t_s: np.ndarray  # (m,)
    phase: np.ndarray  # (m,) index into PHASES, or PAD
    errors: np.ndarray  # (m, 15) truth (-) estimate
    P: np.ndarray  # (m, 15, 15) as reported
    nis: dict  # sensor -> (k,) NIS of every measurement that met the gate
    dof: dict  # sensor -> (k,) its degrees of freedom
    rejected: dict  # sensor -> number of them that the gate refused


def fly(scenario, seed):
    """Fly a scenario until there are no more frames. -> list of StarFix that have an attitude"""
    if not scenario.star_tracker.enabled:
        return []
    until_s = scenario.star_tracker.off + 1.0
    world = prepare.build_world(scenario, seed)
    few = Columns(10)  # which nobody reads: wanted are the star fixes alone
    records = simulate.route(world, scenario, seed, until_s=until_s, columns=few)
    return [one for one in records if isinstance(one, StarFix) and one.reason == Reason.NONE]


def save(path, fixes, head):
    """Keep the fixes of a run in a file, written whole or not at all. head: dict that says what made them."""
    arrays = {
        "head": np.array(json.dumps(head)),
        "number": np.array([fix.number for fix in fixes], dtype=np.int64),
        "times": np.array([(fix.t_valid_s, fix.t_available_s) for fix in fixes]).reshape(-1, 2),
        "q_ic": np.array([fix.q_ic for fix in fixes]).reshape(-1, 4),
        "P_c": np.array([fix.P_c for fix in fixes]).reshape(-1, 3, 3),
        "exposure_s": np.array([fix.exposure_s for fix in fixes], dtype=float),
        "straight": np.array([fix.straight for fix in fixes], dtype=bool),
        "count": np.array([len(fix.hip) for fix in fixes], dtype=np.int64),
        "hip": np.concatenate([fix.hip for fix in fixes] + [np.zeros(0, dtype=np.int64)]),
        "xy_px": np.concatenate([fix.detections.xy_px for fix in fixes] + [np.zeros((0, 2))]),
    }
    files.put_arrays(path, arrays)


def made_by(path):
    """The head of a file of fixes: what made it. Path -> dict"""
    return files.from_json(str(files.arrays(path, ("head",))["head"]))


def provenance(paths):
    """In words, what made some files of fixes: each version of the code, scenario and overrides once."""
    heads = [made_by(path) for path in paths]
    return "; ".join(sorted({_words({key: head.get(key) for key in sorted(head)}) for head in heads}))


def load(path, head=None):
    """The fixes of a file; FlownError if they are not those of `head`. Path, dict -> list

    head : what must have made them, those keys of the file that matter; None: whatever
    """
    try:
        kept = files.arrays(path)
        found = files.from_json(str(kept["head"]))
    except files.UNREADABLE as error:
        raise FlownError(f"{path}: no file of star fixes, or a damaged one; remove it") from error
    kept.setdefault("exposure_s", np.full(len(kept["number"]), np.nan))  # as of older files
    if "straight" not in kept and np.isfinite(kept["exposure_s"]).any():
        raise FlownError(
            f"{path}: an older version kept less of its star fixes than the filter uses; remove it"
        )
    kept.setdefault("straight", np.zeros(len(kept["number"]), dtype=bool))  # of older files yet: nobody asks
    other = {key: found.get(key) for key, value in (head or {}).items() if found.get(key) != value}
    if other:
        raise FlownError(
            f"{path}: its star fixes are those of {_words(other)}, not of {_words(head, other)}; "
            "keep those of other scenarios and overrides in folders of their own"
        )
    ends = np.cumsum(kept["count"])
    return [
        _fix(kept, k, slice(int(end - count), int(end)))
        for k, (end, count) in enumerate(zip(ends, kept["count"], strict=True))
    ]


def _words(head, keys=None):
    """A head, or some keys of it, in words."""
    return ", ".join(f"{key} {head[key]}" for key in keys or head)


def _fix(kept, k, rows):
    """StarFix with what the filter and the bound need of it."""
    n = rows.stop - rows.start
    seen = Detections(
        kept["xy_px"][rows],
        np.full(n, np.nan),
        np.zeros(n, dtype=np.int64),
        np.zeros(n, dtype=np.int64),
        np.full((n, 2, 2), np.nan),
    )
    return StarFix(
        number=int(kept["number"][k]),
        t_valid_s=float(kept["times"][k, 0]),
        t_available_s=float(kept["times"][k, 1]),
        reason=int(Reason.NONE),
        q_ic=kept["q_ic"][k],
        P_c=kept["P_c"][k],
        detections=seen,
        hip=kept["hip"][rows],
        residual_px=np.nan,
        background_dn=np.nan,
        exposure_s=float(kept["exposure_s"][k]),
        flag_saturated=False,
        flag_no_stars=False,
        straight=bool(kept["straight"][k]),
    )


def filter_run(scenario, seed, fixes, *, star_factor=1.0, recorder=None, world=None):
    """Run the filter alone over a run's IMU and GPS and over the fixes.

    Parameters
    ----------
    scenario : Scenario, whose navigation may differ from the one flown
    seed : int
    fixes : list of StarFix of that run
    star_factor : on the sigma that the fixes report, for a filter that believes too much or too little
    recorder : as `fusion.start` takes it
    world : prepare.World of scenario and seed, if it is at hand

    Returns
    -------
    Run
    """
    if scenario.navigation.stars != "attitude":
        raise FlownError("kept fixes have no single stars: navigation.stars must be attitude")
    world = prepare.build_world(scenario, seed) if world is None else world
    fixes = [fix._replace(P_c=star_factor**2 * fix.P_c) for fix in fixes]
    nav = fusion.start(world.computer.nav, world.alignment, world.earth, recorder=recorder)
    gates, states, covariances = _follow(nav, world, fixes)
    if recorder is not None:
        fusion.finish(nav)
    used_s = [gate.t_s for gate in gates if fix_of(gate.sensor) is ATTITUDE and gate.accepted]
    t_s, trajectory = np.array([state.t_s for state in states]), world.flight.trajectory
    errors = _errors(states, trajectory, prepare.true_biases(scenario, seed, trajectory))
    met = [gate for gate in gates if gate.dof > 0]
    names = sorted({gate.sensor for gate in met})
    return Run(
        seed,
        t_s,
        phases(t_s, trajectory, used_s),
        errors,
        covariances,
        {name: np.array([gate.nis for gate in met if gate.sensor == name]) for name in names},
        {name: np.array([gate.dof for gate in met if gate.sensor == name]) for name in names},
        {name: sum(not gate.accepted for gate in met if gate.sensor == name) for name in names},
    )


def _follow(nav, world, fixes):
    """Let a filter hear what the sensors say. -> list of gate results; NavState and (15, 15) of each epoch"""
    blocks, by_time = imu.stacked(world.imu), attrgetter("t_available_s")
    lists = (sorted(records, key=by_time) for records in (world.received, fixes))
    epochs = range(EPOCH_TICKS, len(blocks.t_valid_s) + 1, EPOCH_TICKS)
    arrivals = Recorded(blocks.t_valid_s, *lists, stops=epochs)
    gates, states, covariances = [], [], []
    for k, _, outputs in drive(Navigator(nav, NOTHING), blocks, arrivals):
        gates += [one for one in outputs if isinstance(one, GateResult)]
        if (k + 1) % EPOCH_TICKS == 0:
            states.append(nav.history[-1].state)
            covariances.append(reported(nav))
    return gates, states, np.array(covariances)


class Recorder:
    """Keeps what the filter did as steps of `linear`: intervals from one update or epoch to the next."""

    def __init__(self, begin_s):
        self.begin_s, self.steps, self.levels = begin_s, [], {}

    def __call__(self, what):
        """Take a fusion.Interval or a fusion.Correction, in the order of their instants."""
        if isinstance(what, fusion.Correction):
            if what.fate == Fate.RESET:
                raise FlownError(
                    f"the filter forgot its {what.sensor} block at {what.t_s:.2f} s: there are no "
                    "linear histories of such a run; choose another seed"
                )
            if what.fate == Fate.DOUBTED:  # noise alone
                eye = np.eye(len(what.P))
                self.steps.append(linear.Interval(what.t_s, eye, what.P_forgotten - what.P))
                return
            if what.P_forgotten is not what.P:  # likewise, before it is used
                self.steps.append(linear.Interval(what.t_s, np.eye(len(what.P)), what.P_forgotten - what.P))
            update = linear.Update(what.t_s, what.fix.t_available_s, what.sensor, what.H, what.R)
            self.steps.append(update)
            return
        end_s = what.t_end_s
        self.levels.setdefault(self._epoch(end_s), what.imu.vibration)  # not by a part of the tick after it
        last = self.steps[-1] if self.steps else None
        if isinstance(last, linear.Interval) and not self._is_epoch(last.t_s):
            Q = what.Phi @ last.Q @ what.Phi.T + what.Q
            self.steps[-1] = linear.Interval(end_s, what.Phi @ last.Phi, Q)
        else:
            self.steps.append(linear.Interval(end_s, what.Phi, what.Q))

    def _epoch(self, t_s):
        """Number of the tick that ends nearest to a time."""
        return round((t_s - self.begin_s) * TICK_HZ)

    def _is_epoch(self, t_s):
        tick = self._epoch(t_s)
        return tick % EPOCH_TICKS == 0 and abs(tick / TICK_HZ + self.begin_s - t_s) < SAME_S

    def vibration(self, t_s):
        """Level of the vibration at the ends of ticks, by the strongest motor's. (m,) -> (m,)"""
        return np.array([self.levels[self._epoch(one)] for one in t_s.tolist()])


def reported(nav):
    """Covariance of the core errors as the filter reports it, (15, 15).

    The estimated accelerometer bias contains what the gravity model leaves out (`covariance.covariance`).
    """
    P = covariance.reported(nav)[:N_CORE, :N_CORE].copy()
    P[BA, BA] += nav.params.imu.gravity**2 * np.eye(3)
    return P


def phases(t_s, trajectory, used_s):
    """Phase at each time, given when star fixes were used; without any, the descent begins at the apogee.

    (m,), Trajectory, list -> (m,) int
    """
    k = np.clip(np.searchsorted(trajectory.t_s, t_s - SAME_S), 0, len(trajectory.t_s) - 1)
    first_s, last_s = (used_s[0], used_s[-1]) if used_s else (np.inf, np.inf)
    phase = np.where(t_s < first_s, 1, np.where(t_s <= last_s, 2, 3))
    radius = np.linalg.norm(trajectory.r_i, axis=1)
    top = int(np.argmax(radius))
    if not used_s and radius[top] - max(radius[0], radius[-1]) > RISE:
        phase[t_s > trajectory.t_s[top]] = 4
    phase[trajectory.burning[k] > 0] = 0
    phase[t_s < 0.0] = PAD
    return phase


def _errors(states, trajectory, biases):
    """truth (-) estimate of the core errors. list of NavState, Trajectory, (N, 6) -> (m, 15)"""
    k = np.searchsorted(trajectory.t_s, np.array([state.t_s for state in states]) - SAME_S)
    errors = np.empty((len(states), N_CORE))
    errors[:, POS] = trajectory.r_i[k] - np.array([state.r_i for state in states])
    errors[:, VEL] = trajectory.v_i[k] - np.array([state.v_i for state in states])
    errors[:, ATT] = rotvec_between(np.array([state.q_ib for state in states]), trajectory.q_ib[k])
    errors[:, BG] = biases[k, :3] - np.array([state.gyro_bias for state in states])
    errors[:, BA] = biases[k, 3:] - np.array([state.accel_bias for state in states])
    return errors
