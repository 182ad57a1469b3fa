"""Rate-aided detection of stars in motion: what is found, how well, how fast.

    python benchmarks/streak_detection.py [--fields 20] [--seed 1] [--rate-error 0.0] [--json]

For each camera, shutter and rate: random attitudes and turning axes, the stars of the catalogue to V 6.5, a
slow exact renderer (tests/onboard/streak_fields.py). `found` counts stars whose whole streak lies in the
frame; `false` are objects further than 10 px from any star; `noise` are objects in frames without stars.
Times are of one thread's processor (a busy machine makes them longer too), medians.
"""

import argparse
import json
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "onboard"))
from streak_fields import DEG, IMPA, SHEFEX, dark, detect_params, digitise, frame, match, motion_of, sky

from shefex_nav.geometry.streak import rate_lever
from shefex_nav.onboard.startracker.streak_light import light_at
from shefex_nav.onboard.startracker.streak_path import NUMBERS, TX, TY, X0, X1, Y0, Y1, Turning, path_of
from shefex_nav.onboard.startracker.streaks import detect_near, detect_streaks

MAGNITUDES = (-2.0, 3.2, 4.5, 5.5, 6.0, 6.5)
RATIOS = (5.0, 8.0, 15.0, 30.0, 1e4)
RATES = (0.0, 1.0, 2.0, 5.0, 10.0)
REACH_PX = 10.0


def bound(bench, path, electrons):
    """Cramer-Rao bound along and across [px] and matched ratio of a star on this path."""
    s, dn_per_electron = np.sqrt(bench.sigma_px**2 + 1.0 / 12.0), 1.0 / bench.electrons_per_dn
    flux, margin = electrons * dn_per_electron, 5
    left, right = int(min(path[X0], path[X1])) - margin, int(max(path[X0], path[X1])) + margin + 1
    top, bottom = int(min(path[Y0], path[Y1])) - margin, int(max(path[Y0], path[Y1])) + margin + 1
    rows = np.array(
        [light_at(path, s, float(x), float(y))[:3] for y in range(top, bottom) for x in range(left, right)]
    )
    m, slopes = rows[:, 0], rows * [1.0, flux, flux]
    variance = bench.noise_dn**2 + flux * dn_per_electron * m
    C = np.linalg.inv((slopes / variance[:, None]).T @ slopes)
    return np.sqrt(C[1, 1]), np.sqrt(C[2, 2]), np.sqrt((flux**2 * m**2 / variance).sum())


def one_field(bench, rate, rolling, sigma, rng):
    """Rows V, ratio, found, error along, across, bounds, normalised error; false objects, ms, ms near."""
    params = detect_params(bench)
    omega_c = rng.normal(size=3)
    omega_c *= rate * DEG / np.linalg.norm(omega_c)
    motion = motion_of(bench, omega_c, rolling, sigma)
    xy_px, V = sky(bench, rng)
    electrons = bench.zero_electrons * 10.0 ** (-0.4 * V)
    image = frame(bench, motion, xy_px, electrons, rng)
    motion = motion._replace(omega_c=omega_c + sigma * rng.normal(size=3))
    found, _ = detect_streaks(params, bench.model, image, motion)
    k = match(found.xy_px, xy_px, REACH_PX)
    turning = Turning(bench.camera, omega_c, motion.P_omega_c, motion.times)
    rows, path, size = [], np.empty(NUMBERS), np.array([bench.camera.width_px, bench.camera.height_px])
    for i in range(len(V)):
        path_of(turning, *xy_px[i], path)
        ends = path[[X0, Y0, X1, Y1]].reshape(2, 2)
        if not ((ends >= 0.0) & (ends <= size - 1.0)).all():
            continue
        row = [V[i], *bound(bench, path, electrons[i]), k[i] >= 0, np.nan, np.nan, np.nan]
        if k[i] >= 0:
            error = found.xy_px[k[i]] - xy_px[i]
            row[5:7] = error @ path[[TX, TY]], error @ [-path[TY], path[TX]]
            S = rate_lever(bench.camera, motion.times, omega_c, *xy_px[i])
            P_px = found.P_px[k[i]] + sigma**2 * S @ S.T
            row[7] = 0.5 * error @ np.linalg.solve(P_px, error)
        rows.append(row)
    n_false = int((match(xy_px, found.xy_px, REACH_PX) < 0).sum()) if len(xy_px) else len(found.flux_dn)
    near = found.xy_px[:20] + 0.5 * rng.normal(size=(min(20, len(found.xy_px)), 2))
    P_px = np.tile(0.25 * np.eye(2), (len(near), 1, 1))
    ms = timed(lambda: detect_streaks(params, bench.model, image, motion))
    ms_near = timed(lambda: detect_near(params, bench.model, image, motion, near, P_px))
    empty, _ = detect_streaks(params, bench.model, digitise(bench, dark(bench), rng), motion)
    return np.array(rows).reshape(-1, 8), n_false, len(empty.flux_dn), ms, ms_near


def timed(function, n=5):
    """Least processor time of some runs, ms."""
    least = np.inf
    for _ in range(n):
        begin = time.thread_time()
        function()
        least = min(least, time.thread_time() - begin)
    return 1e3 * least


def spread(values):
    """Standard deviation without the mismatches: from the middle 68 per cent."""
    low, high = np.percentile(values, [15.865, 84.135])
    return 0.5 * (high - low)


def summary(bench, rate, rolling, fields):
    """Figures of some fields."""
    rows = np.vstack([field[0] for field in fields])
    out = {"camera": bench.name, "shutter": "rolling" if rolling else "global", "rate": rate}
    for low, high in pairwise(MAGNITUDES):
        inside = (rows[:, 0] > low) & (rows[:, 0] <= high)
        out[f"V {low:g}..{high:g}"] = f"{int(rows[inside, 4].sum())}/{int(inside.sum())}"
    for name, column in (("false", 1), ("noise", 2)):
        out[name] = float(np.mean([field[column] for field in fields]))
    for name, column in (("ms", 3), ("ms near", 4)):
        out[name] = float(np.median([field[column] for field in fields]))
    for low, high in pairwise(RATIOS):
        part = rows[(rows[:, 3] > low) & (rows[:, 3] <= high) & (rows[:, 4] > 0.0)]
        if len(part) > 5:
            along, across = (spread(part[:, 5 + c] / part[:, 1 + c]) for c in range(2))
            out[f"SNR {low:g}..{high:g}"] = {
                "n": len(part),
                "std px along, across": [float(spread(part[:, 5])), float(spread(part[:, 6]))],
                "over bound along, across": [float(along), float(across)],
                "normalised squared error": float(np.mean(part[:, 7])),
                "... without the worst per cent": float(np.sort(part[:, 7])[: int(0.99 * len(part))].mean()),
            }
    return out


def main():
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--fields", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rate-error", type=float, default=0.0, help="deg/s, one sigma per axis")
    parser.add_argument("--rates", type=float, nargs="*", default=RATES)
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    for bench in (IMPA, SHEFEX):
        for rolling in (False, True):
            for rate in args.rates:
                rng = np.random.default_rng(args.seed)
                one_field(bench, rate, rolling, 0.0, rng)  # compiles
                fields = [
                    one_field(bench, rate, rolling, args.rate_error * DEG, rng) for _ in range(args.fields)
                ]
                result = summary(bench, rate, rolling, fields)
                if args.json:
                    print(json.dumps(result))
                    continue
                for name, value in result.items():
                    print(f"{name:>12}: {value if not isinstance(value, float) else round(value, 2)}")
                print(flush=True)


if __name__ == "__main__":
    main()
