"""Many flights of one scenario, each with its own launch, vehicle and weather: where they go, and what fails.

uv run python benchmarks/dispersed_flights.py [SCENARIO] [--flights 1000] [--workers 2] [--sigma NAME=VALUE]

The flight alone is flown, without sensors and flight software. Flight k of a seed draws the same numbers
whatever else is flown and by however many workers.
"""

import argparse
import json
import os
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import lru_cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np
from missions import SCENARIOS
from scipy.stats import chi2
from scipy.stats import t as student

# One standard deviation each: engineering values for an unguided sounding rocket, to be replaced by one's own
SIGMAS = {
    "elevation": (0.2, "deg", "of the rail"),
    "azimuth": (0.5, "deg", "of the rail"),
    "thrust": (1.0, "%", "of each motor, with its impulse"),
    "misalignment": (0.03, "deg", "of each motor's thrust, about y and z"),
    "drag": (5.0, "%", "axial coefficients"),
    "density": (3.0, "%", "of the air"),
    "wind": (2.0, "m/s", "what the launcher was not set for, at the ground; twice that from 10 km on"),
    "payload": (0.5, "%", "of its mass"),
    "cant": (0.02, "deg", "of the fins"),
    "tip_off": (0.5, "deg/s", "at each separation, about y and z"),
}
WIND_HEIGHTS = np.array([0.0, 1e3, 2e3, 4e3, 6e3, 8e3, 10e3, 15e3, 20e3, 30e3, 60e3])  # m
WIND_MEMORY = 5e3  # m, over which the wind's deviation forgets itself
RATE = 50.0  # Hz, of the samples kept
CHUNK = 10  # flights between two reports of a worker


def dispersed(params, sigmas, rng):
    """FlightParams with everything drawn anew; the order of the draws never changes."""
    one = {name: value * (np.pi / 180.0 if unit.startswith("deg") else 0.01 if unit == "%" else 1.0)
           for name, (value, unit, _) in sigmas.items()}  # fmt: skip

    def draw(name, size=None):
        return one[name] * rng.standard_normal(size)

    start = replace(
        params.start,
        elevation=params.start.elevation + draw("elevation"),
        azimuth=params.start.azimuth + draw("azimuth"),
    )
    drag, cant = 1.0 + draw("drag"), draw("cant")
    air = params.air._replace(density_factor=params.air.density_factor * (1.0 + draw("density")))
    payload = replace(params.payload, mass=params.payload.mass * (1.0 + draw("payload")))
    wind = _wind(params.wind, draw("wind", (len(WIND_HEIGHTS), 2)))
    stages = []
    for stage in params.stages:
        thrust = 1.0 + draw("thrust")
        nozzle = stage.motor.nozzle
        motor = stage.motor._replace(
            vacuum_thrust_n=stage.motor.vacuum_thrust_n * thrust,
            exhaust_speed=stage.motor.exhaust_speed * thrust,  # the propellant burns in the same time
            nozzle=replace(nozzle, misalignment=nozzle.misalignment + draw("misalignment", 2)),
        )
        tip_off, drop = draw("tip_off", 2), stage.separation
        if drop is not None:
            drop = replace(drop, tip_off=drop.tip_off + tip_off)
        aerodynamics = _aerodynamics(stage.aerodynamics, drag, cant)
        stages.append(stage._replace(motor=motor, separation=drop, aerodynamics=aerodynamics))
    upper = params.payload_aerodynamics
    return params._replace(
        start=start,
        air=air,
        wind=wind,
        payload=payload,
        stages=tuple(stages),
        payload_aerodynamics=None if upper is None else _aerodynamics(upper, drag, cant),
    )


def _aerodynamics(tables, drag, cant):
    """Other drag, and another cant where there are fins."""
    finned = np.any(tables.roll_by_cant != 0.0)
    return tables._replace(axial=tables.axial * drag, fin_cant=tables.fin_cant + (cant if finned else 0.0))


def _wind(table, white):
    """Wind of the scenario plus a deviation that is correlated over the height, (m, 3)."""
    keep = np.exp(-np.diff(WIND_HEIGHTS) / WIND_MEMORY)[:, None]
    deviation = white.copy()
    for k in range(1, len(WIND_HEIGHTS)):
        deviation[k] = keep[k - 1] * deviation[k - 1] + np.sqrt(1.0 - keep[k - 1] ** 2) * white[k]
    growth = 1.0 + np.minimum(WIND_HEIGHTS, 10e3) / 10e3
    growth[-1] = 0.0  # nothing is known up there, and nothing is felt
    heights = np.union1d(WIND_HEIGHTS, table[:, 0])
    rows = [heights]
    for column in (0, 1):
        added = np.interp(heights, WIND_HEIGHTS, growth * deviation[:, column])
        mean = np.interp(heights, table[:, 0], table[:, 1 + column]) if len(table) else 0.0
        rows.append(mean + added)
    return np.column_stack(rows)


def fly_some(job):
    """(scenario path, overrides, sigmas, seed, first, last) -> (results, s on the processor).

    results: one dictionary a flight
    """
    path, overrides, sigmas, seed, first, last = job
    start = time.process_time()
    nominal, earth = _loaded(path, overrides)
    results = [_fly_one(nominal, earth, sigmas, seed, k) for k in range(first, last)]
    return results, time.process_time() - start


@lru_cache(maxsize=1)
def _loaded(path, overrides):
    """FlightParams and EarthRotation of a scenario; once in each process."""
    from shefex_nav import prepare
    from shefex_nav.scenario import load, params

    scenario = load.load(path, overrides)
    if scenario.launch is None:
        raise SystemExit(f"{path}: only launches can be dispersed")
    nominal = params.flight_params(scenario)._replace(sample_rate_hz=RATE)
    return nominal, prepare.earth_rotation(scenario)


def _fly_one(nominal, earth, sigmas, seed, k):
    """Result of flight k; -1 is the nominal one."""
    from shefex_nav.world.flight import fly, timeline

    streams = np.random.SeedSequence(seed, spawn_key=(max(k, 0),)).spawn(2)
    vehicle_rng, reference_rng = (np.random.default_rng(stream) for stream in streams)
    params = nominal if k < 0 else dispersed(nominal, sigmas, vehicle_rng)
    try:
        flight = fly.fly(params, earth, None if k < 0 else reference_rng)
    except (timeline.FlightError, ValueError) as error:
        return {"flight": k, "failure": str(error)}
    return {"flight": k, "failure": _shortcoming(nominal, flight), **_figures(nominal, flight, earth)}


def _shortcoming(nominal, flight):
    """Why a flight that came down all the same counts as failed; None: it does not."""
    names = {event.name for event in flight.events}
    if "impact" not in names:
        return "in the air at the time limit"
    if "cold_gas_empty" in names:
        return "cold gas used up"
    late = nominal.programme and nominal.programme[-1][1].end
    if late and late > flight.trajectory.t_s[-1]:
        return "down before the programme ended"
    return None


def _figures(nominal, flight, earth):
    """Apogee, highest dynamic pressure, gas, and the impact: distance and direction from the launch."""
    from shefex_nav.geometry import frames, wgs84
    from shefex_nav.report import track

    at = {event.name: event for event in flight.events}
    trajectory, start = flight.trajectory, nominal.start
    k = len(trajectory.t_s) - 1  # the last sample, at most 20 ms before the impact
    r_e, v_e = frames.ecef_from_inertial(earth, trajectory.t_s[k], trajectory.r_i[k], trajectory.v_i[k])
    impact = at.get("impact", at["apogee"])
    latitude, longitude, _ = wgs84.geodetic_from_ecef(r_e + (impact.t_s - trajectory.t_s[k]) * v_e)
    away = track.ground_distance(start.latitude, start.longitude, latitude, longitude)
    east, north = (r_e - wgs84.ecef_from_geodetic(start.latitude, start.longitude, 0.0)) @ wgs84.dcm_el(
        start.latitude, start.longitude
    )[:, :2]
    return {
        "apogee_km": 1e-3 * at["apogee"].altitude_m,
        "apogee_s": at["apogee"].t_s,
        "range_km": 1e-3 * away,
        "azimuth_deg": float(np.degrees(np.arctan2(east, north))),
        "impact_s": impact.t_s,
        "max_q_kpa": 1e-3 * float(trajectory.dynamic_pressure_pa.max()),
        "latitude_deg": float(np.degrees(latitude)),
        "longitude_deg": float(np.degrees(longitude)),
        "gas_kg": 0.0 if flight.control is None else float(flight.control.propellant_kg[-1]),
    }


def fly_all(job, flights, workers):
    """Nominal result, all others in order, and their time: s, s on the processors; a bar on stderr."""
    from rich.console import Console
    from rich.progress import Progress

    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ[name] = "1"
    (nominal,), _ = fly_some((*job, -1, 0))  # compiles before the workers start
    start = time.perf_counter()
    with (
        Progress(console=Console(stderr=True)) as progress,
        ProcessPoolExecutor(max_workers=workers, mp_context=get_context("spawn")) as pool,
    ):
        task = progress.add_task("flights", total=flights)
        jobs = [(*job, first, min(first + CHUNK, flights)) for first in range(0, flights, CHUNK)]
        futures = [pool.submit(fly_some, one) for one in jobs]
        for future in as_completed(futures):
            progress.advance(task, len(future.result()[0]))
        done = [future.result() for future in futures]
    results = [result for some, _ in done for result in some]
    return nominal, results, time.perf_counter() - start, sum(busy for _, busy in done)


def spread(values):
    """Mean and standard deviation of a sample, each with its 95 % interval: two triples."""
    n, mean, sigma = len(values), np.mean(values), np.std(values, ddof=1)
    half = student.ppf(0.975, n - 1) * sigma / np.sqrt(n)
    low, high = (sigma * np.sqrt((n - 1) / chi2.ppf(q, n - 1)) for q in (0.975, 0.025))
    return (mean, mean - half, mean + half), (sigma, low, high)


def impacts(nominal, results):
    """Impacts relative to the nominal one, (n, 2) km along its direction from the launch and to the right.

    In the plane whose polar coordinates are distance and direction from the launch.
    """
    turned = np.radians([result["azimuth_deg"] - nominal["azimuth_deg"] for result in results])
    away = np.array([result["range_km"] for result in results])
    return np.column_stack([away * np.cos(turned) - nominal["range_km"], away * np.sin(turned)])


def report(nominal, results):
    """Print the figures."""
    good = [result for result in results if result["failure"] is None]
    print(f"{len(good)} of {len(results)} flights as planned")
    reasons = [result["failure"] for result in results if result["failure"]]
    for reason in sorted(set(reasons), key=reasons.count, reverse=True):
        print(f"  {reasons.count(reason):5d} failed: {reason}")
    if len(good) < 3:
        return
    print(f"\n{'':<24}{'nominal':>9}{'mean':>10}{'sigma':>9}   95 % of mean and of sigma")
    rows = [(name, nominal[key], [result[key] for result in good]) for name, key in (
        ("apogee km", "apogee_km"), ("time of apogee s", "apogee_s"), ("range km", "range_km"),
        ("time of impact s", "impact_s"), ("dynamic pressure kPa", "max_q_kpa"), ("cold gas kg", "gas_kg"),
    )]  # fmt: skip
    offset = impacts(nominal, good)
    rows += [("impact, further km", 0.0, offset[:, 0]), ("impact, to the right km", 0.0, offset[:, 1])]
    for name, planned, values in rows:
        mean, sigma = spread(values)
        print(
            f"{name:<24}{planned:9.3f}{mean[0]:10.3f}{sigma[0]:9.3f}   {mean[1]:.3f} ... {mean[2]:.3f},"
            f" {sigma[1]:.3f} ... {sigma[2]:.3f}"
        )
    variances, axes = np.linalg.eigh(np.cov(offset.T))
    tilt = np.degrees(np.arctan2(axes[1, 1], axes[0, 1])) % 180.0
    long, short = np.sqrt(chi2.ppf(0.95, 2) * variances[::-1])
    print(f"\n95 % of the impacts: ellipse of {long:.1f} by {short:.1f} km (half axes), the longer one")
    print(f"{tilt:.0f} deg to the right of the nominal direction")


def _sigmas(changes):
    sigmas = dict(SIGMAS)
    for change in changes:
        name, _, value = change.partition("=")
        if name not in sigmas or not value:
            raise SystemExit(f"--sigma {change}: expected NAME=VALUE, NAME one of {', '.join(sigmas)}")
        sigmas[name] = (float(value), *sigmas[name][1:])
    return sigmas


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenario", nargs="?", default=SCENARIOS / "shefex2_andoya.yaml", type=Path)
    parser.add_argument("--flights", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--seed", type=int, default=0)
    known = ", ".join(f"{name} {value:g} {unit}" for name, (value, unit, _) in SIGMAS.items())
    parser.add_argument(
        "--sigma",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="one standard deviation: " + known.replace("%", "%%"),
    )
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="as of shefex-nav run"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write every flight's figures too")
    options = parser.parse_args()
    sigmas = _sigmas(options.sigma)
    job = (str(options.scenario), tuple(options.set), sigmas, options.seed)
    nominal, results, seconds, busy = fly_all(job, options.flights, options.workers)
    if nominal["failure"]:
        raise SystemExit(f"the nominal flight fails: {nominal['failure']}")
    print(f"{options.scenario.stem}, seed {options.seed}, one standard deviation of:")
    for name, (value, unit, what) in sigmas.items():
        print(f"  {name:<14}{value:6g} {unit:<6} {what}")
    print()
    report(nominal, results)
    print(f"\n{seconds:.1f} s with {options.workers} workers, {busy:.1f} s on the processors")
    if options.json:
        figures = {"seed": options.seed, "nominal": nominal, "flights": results}
        options.json.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
