"""A flown budget of errors against the linear model: uv run python benchmarks/budget_linear.py BUDGET.json

The linear model of `verify bound` says what each error of the world adds to the variance at entry and at the
end, for the best gains there are; `shefex-nav budget --json` says what it adds to the flown errors of the
built-in filter. Shares of the mean square, in per cent. Without a file: the linear shares alone.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from shefex_nav import prepare
from shefex_nav.geometry import rotation
from shefex_nav.scenario import load, surroundings
from shefex_nav.verify import bound, bound_model, linear, over_bound
from shefex_nav.verify.trade import stars

PLACES = {  # error of the budget: source of the bound
    "gyro_bias": "gyro_bias",
    "gyro_in_run_bias": "gyro_in_run_bias",
    "gyro_scale_factor": "gyro_scale_factor",
    "gyro_misalignment": "gyro_misalignment",
    "gyro_g_sensitivity": "gyro_g_sensitivity",
    "gyro_vibration_rectification": "gyro_rectification",
    "accelerometer_bias": "accel_bias",
    "accelerometer_in_run_bias": "accel_in_run_bias",
    "accelerometer_scale_factor": "accel_scale_factor",
    "accelerometer_misalignment": "accel_misalignment",
    "accelerometer_vibration_rectification": "accel_rectification",
    "camera_mounting": "mounting",
    "gravity": "gravity",
}
FIXES, WHITE = "gps_noise + star_noise", "white noise of the IMU, alignment"
QUANTITIES = "position", "velocity", "attitude"


def shares(scenario, seed, number):
    """{source: {instant: (3,)}} of the mean squares of position, velocity, attitude."""
    scenario = prepare.settled(scenario)
    flight = prepare.fly_vehicle(scenario, seed)
    world = prepare.with_faults(scenario, prepare.measure(scenario, seed, flight))
    fixes = stars.star_fixes(scenario, prepare.unmeasured(scenario, seed, flight), seed, stars.EVERY_S).fixes
    along = over_bound.flight_of(scenario, world, list(fixes))
    field = surroundings.gravity(scenario)
    layout = bound_model.sources(
        along.imu, along.camera, *bound.gravity_process(field, flight.trajectory, along.earth)
    )
    at = _instants(flight.trajectory, along.earth)
    every = {name: [layout.places[place]] for name, place in PLACES.items()}
    every[WHITE] = [slice(0, bound_model.N_NAV)]
    found = {}
    for name, places in {**every, FIXES: []}.items():
        states = np.zeros(layout.n)
        for place in places:
            states[place] = 1.0
        share = linear.Share(states, name == FIXES)
        found[name] = _squares(along, layout, at, share, number)
    return found


def _instants(trajectory, earth):
    from shefex_nav.verify.trade import predict

    return predict._wanted(trajectory, earth)  # samples of entry and end


def _squares(along, layout, at, share, number):
    """{instant: (3,)} mean squares of histories of a share."""
    samples, rng = np.array(sorted(at)), np.random.default_rng(1)
    found = {}
    for k, output in bound.outputs_at(along, layout, samples, rng=rng, number=number, share=share):
        e = output.errors
        C_ib = rotation.dcm_from_quat(along.trajectory.q_ib[k])
        found[at[k]] = np.array(
            [np.mean(np.sum(part**2, axis=0)) for part in (e[0:3], e[3:6], C_ib.T @ e[6:9])]
        )
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("budget", nargs="?", type=Path)
    parser.add_argument("--scenario", default="shefex2_andoya")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--histories", type=int, default=1000)
    given = parser.parse_args()
    scenario = load.load(given.scenario, ("star_tracker.frames=statistical",))
    found = shares(scenario, given.seed, given.histories)
    flown = json.loads(given.budget.read_text()) if given.budget else {"sources": {}}
    for instant in ("entry", "end"):
        total = sum(one[instant] for one in found.values())
        print(f"{instant}: linear sigma {np.sqrt(total) * [1.0, 1.0, np.degrees(1.0)]} m, m/s, deg")
        for name, one in found.items():
            words = [f"{100.0 * value:6.2f}" for value in one[instant] / total]
            for quantity, value in zip(QUANTITIES, range(3), strict=True):
                of = flown["sources"].get(name)
                if of:
                    one_of = of[instant][quantity]
                    words[value] += f" | {100.0 * one_of['share']:6.2f} ({100.0 * one_of['low']:.1f} to "
                    words[value] += f"{100.0 * one_of['high']:.1f})"
            print(f"  {name:38}" + "".join(f"{word:34}" for word in words))


if __name__ == "__main__":
    main()
