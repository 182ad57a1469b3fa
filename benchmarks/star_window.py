"""Star tracker in its window over many skies: boresight, roll about it and residual rates dispersed by seed.

The boresight is anywhere within 5 deg of the nominal one, the roll about it anything, the residual rate
anything up to 2 deg/s in any direction. Prints success, wrong attitudes, errors and chain times.

    uv run python benchmarks/star_window.py [--seeds 20]
"""

import argparse

import numpy as np
from missions import SCENARIOS, fly_all

from shefex_nav.scenario import load


def dispersed(seed, azimuth_deg, elevation_deg):
    """(rate, overrides) of one seed about the nominal direction; the attitude is exactly as asked for."""
    rng = np.random.default_rng([seed, 2012])
    offset, direction = 5.0 * np.sqrt(rng.random()), 2.0 * np.pi * rng.random()
    elevation = elevation_deg + offset * np.cos(direction)
    azimuth = azimuth_deg + offset * np.sin(direction) / np.cos(np.radians(elevation))
    rate, about = 2.0 * rng.random(), rng.uniform(-1.0, 1.0)
    values = {
        "slew.azimuth": f"{azimuth:.3f} deg",
        "slew.elevation": f"{elevation:.3f} deg",
        "slew.roll": f"{rng.uniform(-180.0, 180.0):.2f} deg",
        "pointing.boresight_rate": f"{rate * about:.4f} deg/s",
        "pointing.cross_rate": f"{rate * np.sqrt(1.0 - about**2):.4f} deg/s",
        "pointing.cross_period": "8 s",  # so that the boresight stays within 2.5 deg of its place
        "pointing.cross_phase": f"{rng.uniform(0.0, 360.0):.1f} deg",
        "pointing.ramp": "3 s",
    }
    return rate, ("attitude=prescribed", *(f"programme.{key}={value}" for key, value in values.items()))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20)
    seeds = range(parser.parse_args().seeds)
    path = str(SCENARIOS / "shefex2_andoya.yaml")
    slew = load.load(path).programme["slew"]
    nominal = np.degrees([slew.azimuth, slew.elevation])
    draws = [dispersed(seed, *nominal) for seed in seeds]
    runs = fly_all([(path, overrides, seed) for seed, (_, overrides) in zip(seeds, draws, strict=True)])
    print("seed  rate deg/s  window  solved  wrong  cross rms  boresight rms  max arcsec  median ms  p99 ms")
    for seed, (rate, _), run in zip(seeds, draws, runs, strict=True):
        star, error = run["star_tracker"], run["star_tracker"]["error_arcsec"]
        print(
            f"{seed:4d}  {rate:10.2f}  {star['in_window']:6d}  {star['solved']:6d}  {star['wrong']:5d}"
            f"  {error['cross_axis_rms']:9.1f}  {error['boresight_rms']:13.1f}  {error['max']:10.1f}"
            f"  {star['chain_ms']['median']:9.2f}  {star['chain_ms']['p99']:6.2f}  {star['no_fix']}"
        )
    total = sum(run["star_tracker"]["in_window"] for run in runs)
    solved = sum(run["star_tracker"]["solved"] for run in runs)
    wrong = sum(run["star_tracker"]["wrong"] for run in runs)
    errors_deg = np.degrees(np.concatenate([run["fix_errors_c"] for run in runs]))
    sigmas_deg = np.degrees(np.concatenate([run["fix_sigmas_c"] for run in runs]))
    three_sigma = 3.0 * np.sqrt((errors_deg**2).mean(axis=0))
    inside = (np.abs(errors_deg) < 0.1).mean(axis=0)
    nees = ((errors_deg / sigmas_deg) ** 2).mean(axis=0)
    print(f"solved {solved} of {total} = {100 * solved / total:.2f} %, wrong {wrong}")
    print(f"3 sigma about camera x, y, z: {np.array2string(three_sigma, precision=4)} deg")
    print(f"share of errors within 0.1 deg about x, y, z: {inside}")
    print(f"mean squared error over reported variance about x, y, z: {np.array2string(nees, precision=2)}")
    medians = [run["star_tracker"]["chain_ms"]["median"] for run in runs]
    p99s = [run["star_tracker"]["chain_ms"]["p99"] for run in runs]
    print(f"chain: median {np.median(medians):.2f} ms, 99th percentile at worst {max(p99s):.2f} ms")


if __name__ == "__main__":
    main()
