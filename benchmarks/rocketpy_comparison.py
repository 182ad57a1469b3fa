"""One flight of RocketPy's Calisto, flown by RocketPy and by this project in one process: results and times.

uv run --with rocketpy python benchmarks/rocketpy_comparison.py [--calm] [--repeat 7] [--json FILE]

Both fly from the rail to the ground without parachutes; figures are of the ascent. Further rows change one
thing at a time, in RocketPy or here, and show what it is worth.
"""

import argparse
import json
import statistics
import time
import warnings
from importlib.metadata import version
from pathlib import Path

import calisto
import numpy as np
from rocketpy import Flight

from shefex_nav.environment.gravity import normal_gravity_e
from shefex_nav.geometry import frames, wgs84
from shefex_nav.world.flight import fly

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 0.0, wgs84.OMEGA)
MEASURES = (  # name in two words, unit, digits
    ("rail exit", "s", 4),
    ("exit speed", "m/s", 3),
    ("max speed", "m/s", 2),
    ("max Mach", "", 4),
    ("max roll", "rad/s", 3),
    ("apogee height", "m", 2),
    ("apogee time", "s", 3),
    ("apogee east", "m", 2),
    ("apogee north", "m", 2),
)
FASTER = 5.0  # than RocketPy, as we want to be
NOTES = """
Rows below the first: difference from it; in RocketPy, one change at a time:
  integrated closely       relative and absolute tolerance 1e-10
  our gravity              normal gravity of WGS 84 in closed form; RocketPy's is Somigliana and a series
  our air                  the same standard every 50 m; RocketPy's speed of sound is linear over kilometres
  lever arms turned        from the dry to the whole centre of mass, not back (RocketPy issue 1186)
  jet damping of the exit  of a disc at the distance of the exit; RocketPy has a quarter of its square
  steady flow              without the force of gas that speeds up or slows down inside the motor
  here: damping ...        pitch damping about the centre of mass at lift-off instead of burn-out
The last row has no single reason: tables for functions, side force by the rate of turn, the round Earth."""


def by_rocketpy(rocket, environment, **options):
    """Fly in RocketPy. -> rocketpy.Flight"""
    return Flight(
        rocket=rocket,
        environment=environment,
        rail_length=calisto.RAIL_LENGTH,
        inclination=calisto.INCLINATION,
        heading=calisto.HEADING,
        **options,
    )


def measured_rocketpy(flight):
    """The measures of a flight of RocketPy. -> (9,)"""
    top = flight.apogee_time
    t_s, roll = flight.w3[:, 0], flight.w3[:, 1]
    return np.array(
        [
            flight.out_of_rail_time,
            flight.out_of_rail_velocity,
            flight.max_speed,
            flight.max_mach_number,
            np.abs(roll[t_s <= top]).max(),
            flight.apogee - calisto.ELEVATION,
            top,
            flight.x(top),
            flight.y(top),
        ]
    )


def measured_here(flight):
    """The same measures of ours: heights above the rail's foot, places in its tangent plane. -> (9,)"""
    trajectory = flight.trajectory
    at = {event.name: event for event in flight.events}
    top = at["apogee"].t_s
    n = int(np.searchsorted(trajectory.t_s, top)) + 2  # two samples beyond the apogee
    t_s = trajectory.t_s[:n]
    r_e, v_e = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        r_e[k], v_e[k] = frames.ecef_from_inertial(EARTH, t_s[k], trajectory.r_i[k], trajectory.v_i[k])
    speed = np.linalg.norm(v_e, axis=1)
    latitude, longitude = np.radians(calisto.LATITUDE), np.radians(calisto.LONGITUDE)
    foot_e = wgs84.ecef_from_geodetic(latitude, longitude, calisto.ELEVATION)
    places = (r_e - foot_e) @ wgs84.dcm_el(latitude, longitude)  # east, north, up
    exit_s = at["rail_exit"].t_s
    return np.array(
        [
            exit_s,
            np.interp(exit_s, t_s, speed),
            speed.max(),
            trajectory.mach[:n].max(),
            np.abs(trajectory.omega_ib_b[:n, 0]).max(),
            at["apogee"].altitude_m - calisto.ELEVATION,
            top,
            np.interp(top, t_s, places[:, 0]),
            np.interp(top, t_s, places[:, 1]),
        ]
    )


def variants(wind):
    """[(what, measures)]: RocketPy as it comes, with one change at a time, with all of them; then here."""
    latitude = np.radians(calisto.LATITUDE)
    plain, ours = calisto.environment(wind), calisto.environment(wind, our_air=True)

    def gravity(height):
        return np.linalg.norm(normal_gravity_e(wgs84.ecef_from_geodetic(latitude, 0.0, height)))

    weighed = calisto.environment(wind, gravity=gravity)
    changes = (calisto.turn_lever_arms, calisto.whole_jet_damping, calisto.steady_flow)
    rocket, turned, damped, steady, changed = (calisto.rocket() for _ in range(5))
    for change, one in zip(changes, (turned, damped, steady), strict=True):
        change(one)
        change(changed)
    close = {"rtol": 1e-10, "atol": 1e-10, "max_time_step": 0.01}  # longer steps make LSODA give up
    rows = [
        ("RocketPy", rocket, plain, {}),
        ("  integrated closely", rocket, plain, close),
        ("  our gravity", rocket, weighed, {}),
        ("  our air", rocket, ours, {}),
        ("  lever arms turned", turned, plain, {}),
        ("  jet damping of the exit", damped, plain, {}),
        ("  steady flow", steady, plain, {}),
        ("  all of these", changed, ours, close),
    ]
    flown = [(what, measured_rocketpy(by_rocketpy(one, env, **options))) for what, one, env, options in rows]
    here = [
        ("here", {}),
        ("  EGM96", {"field": "egm96"}),
        ("  damping as at lift-off", {"damping_at_s": 0.0}),
    ]
    for what, options in here:
        flight = fly.fly(calisto.flight_params(rocket, wind=wind, **options), EARTH, None)
        flown.append((what, measured_here(flight)))
    return flown


def timed(function, repeat):
    """Median of the times on the processor, s; both sides work in one thread."""
    durations = []
    for _ in range(repeat):
        start = time.process_time()
        function()
        durations.append(time.process_time() - start)
    return statistics.median(durations)


def timing(rocket, wind, repeat):
    """Median times: whole flight and ascent alone in RocketPy, whole flight here, s."""
    environment, params = calisto.environment(wind), calisto.flight_params(rocket, wind=wind)
    return {
        "rocketpy_to_ground_s": timed(lambda: by_rocketpy(rocket, environment), repeat),
        "rocketpy_to_apogee_s": timed(
            lambda: by_rocketpy(rocket, environment, terminate_on_apogee=True), repeat
        ),
        "here_to_ground_s": timed(lambda: fly.fly(params, EARTH, None), repeat),
    }


def table(rows):
    """Print RocketPy's measures, how every other row differs from them, and what is left in the end."""
    for line in zip(*[(*name.split(" "), unit) for name, unit, _ in MEASURES], strict=True):
        print(" " * 28 + "".join(f"{word:>10}" for word in line))
    values = dict(rows)
    first, changed, here = values["RocketPy"], values["  all of these"], values["here"]
    lines = [(what, own if own is first else own - first, "" if own is first else "+") for what, own in rows]
    for what, shown, sign in [*lines, ("here, from all of these", here - changed, "+")]:
        cells = [f"{value:{sign}.{digits}f}" for value, (_, _, digits) in zip(shown, MEASURES, strict=True)]
        print(f"{what:<28}" + "".join(f"{cell:>10}" for cell in cells))
    print(NOTES)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calm", action="store_true", help="without wind")
    parser.add_argument(
        "--repeat", type=int, default=7, help="flights for a time, of which the median counts"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures too")
    options = parser.parse_args()
    warnings.filterwarnings("ignore", module="rocketpy")
    wind = not options.calm
    rows = variants(wind)
    times = timing(calisto.rocket(), wind, options.repeat)
    whole = times["rocketpy_to_ground_s"] / times["here_to_ground_s"]
    ascent = times["rocketpy_to_apogee_s"] / times["here_to_ground_s"]
    print(f"Calisto, RocketPy {version('rocketpy')}, {'wind' if wind else 'calm'}\n")
    table(rows)
    print(f"\nTimes on the processor, median of {options.repeat}, after compilation")
    for name, seconds in times.items():
        print(f"  {name.removesuffix('_s').replace('_', ' '):<22} {1e3 * seconds:8.1f} ms")
    print(f"  RocketPy / here, whole flight: {whole:.1f}; its ascent alone / our whole flight: {ascent:.1f}")
    print(f"  wanted: {FASTER:.0f} or more: {'reached' if whole >= FASTER else 'MISSED'}")
    if options.json:
        names = [name for name, _, _ in MEASURES]
        flights = {what.strip(): dict(zip(names, values.tolist(), strict=True)) for what, values in rows}
        figures = {"rocketpy": version("rocketpy"), "wind": wind, "flights": flights, "times": times}
        options.json.write_text(json.dumps(figures, indent=2) + "\n")


if __name__ == "__main__":
    main()
