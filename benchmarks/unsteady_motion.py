"""Attitudes of frames within which the rate of the camera changes: how far off, by their own covariance.

    uv run python benchmarks/unsteady_motion.py [--frames 30] [--seed 771]

Rendered frames of the default camera, global and rolling shutter, as spots and along streaks, with exact
gyros: the mean normalised squared error (3 expected) by the mean rate alone, and with what the gyros say of
its changes. Frames and motions are those of tests/onboard/test_unsteady_frames.py.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import shefex_nav.simulate  # noqa: F401 the methods of the star tracker

TESTS = Path(__file__).resolve().parent.parent / "tests"
sys.path[:0] = [str(TESTS / "onboard"), str(TESTS / "world")]

import test_unsteady_frames as frames  # noqa: E402
from star_fields import DEG  # noqa: E402

CAMERAS = {
    "global, sequential": (frames.EXACT, "sequential"),
    "global, streaks": (frames.EXACT, "streaks"),
    "rolling, streaks": (frames.ROLLING, "streaks"),
}


def accelerating(rate_deg_s2):
    """0.5 deg/s about one axis, an acceleration about the two others."""
    across = 0.5 * rate_deg_s2 * DEG
    return lambda t: np.array([0.5 * DEG * t, across * t**2, 0.3 * across * t**2])


MOTIONS = {
    "0.5 deg/s, steady": accelerating(0.0),
    "and 5 deg/s2": accelerating(5.0),
    "and 20 deg/s2": accelerating(20.0),
    "and 60 deg/s2": accelerating(60.0),
    "30 deg/s2 along the streaks": frames.spinning_up,
    "shaken at 25 Hz, 1 deg/s": frames.shaken,
}


def main():
    """Print a row for each motion: mean rate alone, with its changes, for each camera."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=30, help="of each kind")
    parser.add_argument("--seed", type=int, default=771)
    asked = parser.parse_args()
    print(f"{'motion':30s}" + "".join(f"{name:>28s}" for name in CAMERAS))
    for name, theta_c in MOTIONS.items():
        row = []
        for params, scan in CAMERAS.values():
            found = []
            for knows in (False, True):
                errors = frames.squared_errors(
                    params, theta_c, scan, knows, n_frames=asked.frames, seed=asked.seed
                )
                solved = errors[np.isfinite(errors)]
                found.append(f"{solved.mean():.1f} ({len(solved)})" if len(solved) else "- (0)")
            row.append(f"{', '.join(found):>28s}")
        print(f"{name:30s}" + "".join(row), flush=True)


if __name__ == "__main__":
    main()
