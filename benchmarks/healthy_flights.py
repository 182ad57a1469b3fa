"""Flights without faults whose instruments are others, told rightly: is any of them called wrong?

uv run python benchmarks/healthy_flights.py [--flights 40] [--first 1] [--jobs 2] [--aids]
    [--set KEY=VALUE] [--json FILE]

Each flight draws its scenario (default mission by statistics, the same without stars, `rexus_like`, `tight`)
and, each with a chance of a third to a half, the receiver's noise, rate, latency and antenna, the classes of
gyros and accelerometers, their calibration and quanta, the vibration and the alignment, over factors of 10
to 1000. Every fourth is drawn as `precise`: velocities of 2 to 30 mm/s, a lever arm of 0.5 to 2.5 m and gyros
whose noise over it is as large. With --aids the flights have a barometer, a magnetometer or both, drawn over
factors of 0.1 to 10, and fly the default mission, `rexus_like` or `baro_2d_gps`. Prints each flight with what
was told of its sensors, its misleading events and its largest errors over their levels. Exit code 1 if a
sensor is called wrong or a flight misleads.

Sensors that really end (signals lost, an accelerometer at the end of its range) are not counted.
"""

import argparse
import json
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

SCENARIOS = "shefex2_andoya", "no_star_tracker", "rexus_like", "tight"
BY_STATISTICS = "star_tracker.frames=statistical"
REAL = "no fix", "no ranges", "at the end of its range", "not used:"  # true of a healthy flight, too
QUANTITIES = "position", "velocity", "attitude"
GYRO = "bias=0.5 deg/h", "in_run_bias=0.1 deg/h"
ACCELEROMETER = "bias=0.5 mgee", "in_run_bias=50 ugee"


class Draw:
    """Random numbers of a flight."""

    def __init__(self, seed):
        self.rng = np.random.default_rng([seed, 404])

    def chance(self, p):
        return self.rng.uniform() < p

    def one_of(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def between(self, low, high):
        """Evenly by the logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))


def drawn(seed, aids=False):
    """Scenario and settings of a flight."""
    draw = Draw(seed)
    if aids:
        scenario = draw.one_of("shefex2_andoya", "rexus_like", "baro_2d_gps")
        found = [
            "navigation.states=automatic",
            BY_STATISTICS,
            *aided(draw, scenario),
            *receiver(draw),
            *inertial(draw),
        ]
        return scenario, found + around(draw, scenario)
    scenario = SCENARIOS[(seed // 4) % 4] if seed % 4 == 0 else draw.one_of(*SCENARIOS)
    found = ["navigation.states=automatic"]
    if scenario != "no_star_tracker":
        found.append(BY_STATISTICS)
    if seed % 4 == 0:
        return scenario, found + precise(draw) + around(draw, scenario)
    return scenario, found + receiver(draw) + inertial(draw) + around(draw, scenario)


def precise(draw):
    """A receiver whose velocities are as precise as gyros and lever arm let them be predicted."""
    arm = draw.rng.standard_normal(3)
    arm *= draw.between(0.5, 2.5) / np.linalg.norm(arm)
    return [
        f"imu.gyro.random_walk={draw.between(0.15, 1.5):.4g} deg/sqrt(h)",
        f"imu.gyro.quantum={draw.one_of(1, 3, 5, 10)} arcsec",
        f"gps.range_rate_noise={draw.between(2.0, 30.0):.4g} mm/s",
        f"gps.rate={draw.one_of(1, 2, 5, 10)} Hz",
        lever_arm(arm),
    ]


def lever_arm(arm):
    return "gps.antenna.lever_arm=[{:.3f} m, {:.3f} m, {:.3f} m]".format(*arm)


def receiver(draw):
    found = [f"gps.rate={draw.one_of(1, 1, 2, 5, 10, 20)} Hz"]
    if draw.chance(0.5):
        found.append(f"gps.range_noise={1.5 * draw.between(0.2, 5.0):.4g} m")
    if draw.chance(0.5):
        found.append(f"gps.range_rate_noise={0.05 * draw.between(0.1, 10.0):.4g} m/s")
    if draw.chance(0.5):
        found.append(f"gps.latency={draw.one_of(0.0, 0.01, 0.05, 0.1, 0.2, 0.4)} s")
    if draw.chance(0.5):
        found.append(lever_arm(draw.rng.uniform(-1.0, 1.0, 3) * [2.0, 0.5, 0.5]))
    return found


def inertial(draw):
    """Class of the sensors, then single errors of theirs."""
    found = []
    if draw.chance(0.5):
        found += sensor_class("gyro", GYRO, "deg/sqrt(h)", draw.between(0.1, 100.0))
    if draw.chance(0.5):
        found += sensor_class("accelerometer", ACCELEROMETER, "m/s/sqrt(h)", draw.between(0.1, 30.0))
    for name, usual, unit, most in (
        ("gyro.scale_factor", 100.0, "ppm", 30.0),
        ("gyro.misalignment", 0.05, "mrad", 30.0),
        ("gyro.g_sensitivity", 0.5, "deg/h/gee", 60.0),
        ("accelerometer.scale_factor", 300.0, "ppm", 30.0),
        ("accelerometer.misalignment", 0.1, "mrad", 30.0),
    ):
        if draw.chance(0.3):
            found.append(f"imu.{name}={usual * draw.between(0.1, most):.4g} {unit}")
    if draw.chance(0.3):
        found.append(f"imu.gyro.quantum={draw.one_of(0.01, 1, 5)} arcsec")
    return found


def aided(draw, scenario):
    """Barometer, magnetometer or both."""
    which = draw.one_of("barometer", "magnetometer", "both")
    found = []
    if scenario == "baro_2d_gps" or which != "magnetometer":
        found += readings(draw, "barometer", draw.one_of("1 Pa", "20 Pa", "100 Pa"))
        for name, usual, unit in (
            ("bias", 100.0, "Pa"),
            ("drift", 20.0, "Pa"),
            ("noise", 5.0, "Pa"),
            ("lag", 20.0, "ms"),
            ("day.pressure", 5.0, "hPa"),
            ("day.temperature", 5.0, "K"),
        ):
            found.append(f"barometer.{name}={usual * draw.between(0.1, 10.0):.4g} {unit}")
    if which != "barometer":
        found += readings(draw, "magnetometer", draw.one_of("1 nT", "15 nT", "150 nT"))
        for name, usual, unit in (("hard_iron", 500.0, "nT"), ("noise", 50.0, "nT"), ("soft_iron", 0.3, "%")):
            found.append(f"magnetometer.{name}={usual * draw.between(0.1, 10.0):.4g} {unit}")
        found.append(f"navigation.magnetometer.rows={draw.one_of('field', 'heading')}")
    return found


def readings(draw, name, quantum):
    """When an instrument reads, and in what steps."""
    rate, latency = draw.one_of(1, 5, 10, 20, 50), draw.one_of(0.0, 0.01, 0.05, 0.2)
    return [f"{name}.rate={rate} Hz", f"{name}.latency={latency} s", f"{name}.quantum={quantum}"]


def sensor_class(sensor, biases, unit, factor):
    """Biases times a factor; the noise grows less from class to class."""
    found = [f"imu.{sensor}.random_walk={0.03 * factor**0.7:.4g} {unit}"]
    for bias in biases:
        name, value = bias.split("=")
        number, of = value.split()
        found.append(f"imu.{sensor}.{name}={factor * float(number):.4g} {of}")
    return found


def around(draw, scenario):
    """Vibration, alignment and the time on the pad."""
    found = []
    if draw.chance(0.4):
        level = draw.between(0.1, 3.0)
        motors = (7.0,) if scenario in ("rexus_like", "baro_2d_gps") else (7.0, 3.5)
        found.append(f"imu.vibration.boost=[{', '.join(f'{level * one:.3g} gee' for one in motors)}]")
    if draw.chance(0.3):
        found.append(f"imu.vibration.coast={0.02 * draw.between(0.1, 20.0):.3g} gee")
    if draw.chance(0.4):
        factor = draw.between(0.2, 10.0)
        found.append(f"pad_alignment.level={0.05 * factor:.3g} deg")
        found.append(f"pad_alignment.azimuth={0.3 * factor:.3g} deg")
    if draw.chance(0.3):
        found.append(f"mission.start={draw.one_of(-5, -30, -60, -120)} s")
    return found


def fly(seed, more=(), aids=False):
    """One flight: a row."""
    import shefex_nav as sn

    scenario, settings = drawn(seed, aids)
    run = sn.fly(sn.Scenario.load(scenario, [*settings, *more]), seed=seed)
    summary = run.summary()["navigation"]
    of = [summary["integrity"][name] for name in QUANTITIES]
    called = [
        f"T{one['from_s']:+.1f} s {one['source']}: {one['reason']}"
        for one in summary["integrity"]["noticed"]
        if not any(reason in one["reason"] for reason in REAL)
    ]
    return {
        "seed": seed,
        "scenario": scenario,
        "settings": settings,
        "called": called,
        "misleading_events": sum(one["misleading_events"] for one in of),
        "over_level": [one["over_level"] for one in of],
        "usable": [one["usable_share"] for one in of],
        "nees": summary["nees"]["mean"],
    }


def line(row):
    """Of the table."""
    over = " ".join("   -" if one is None else f"{one:4.2f}" for one in row["over_level"])
    usable = " ".join(f"{one:4.2f}" for one in row["usable"])
    text = f"{row['seed']:6d} {row['scenario']:16s} {over}   {usable}   {row['misleading_events']:3d}"
    return text + "".join(f"\n       {one}" for one in row["called"][:3])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=40)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--aids", action="store_true", help="with a barometer, a magnetometer or both")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE for every flight")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    print("  seed scenario         error over level usable           misleading")
    rows = []
    with ProcessPoolExecutor(given.jobs, mp_context=get_context("spawn")) as pool:
        seeds = range(given.first, given.first + given.flights)
        for row in pool.map(partial(fly, more=given.set, aids=given.aids), seeds):
            rows.append(row)
            print(line(row), flush=True)
    if given.json:
        given.json.write_text(json.dumps(rows, indent=1))
    called = sum(bool(row["called"]) for row in rows)
    misled = sum(row["misleading_events"] > 0 for row in rows)
    print(f"{called} of {len(rows)} called wrong, {misled} mislead")
    return int(bool(called or misled))


if __name__ == "__main__":
    sys.exit(main())
