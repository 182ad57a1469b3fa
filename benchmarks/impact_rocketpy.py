"""Landings of RocketPy's Calisto with dispersions, by RocketPy's Monte Carlo and by this project.

    uv run --with rocketpy python benchmarks/impact_rocketpy.py --flights 800 [--json FILE]

--flights-rocketpy N flies fewer of RocketPy's, which take longer.

Both draw for themselves, from the same distributions: inclination and heading of the rail, impulse, drag,
both components of the wind. The rocket has no parachute and lands nose first. RocketPy flies with the
corrections of `calisto` that rocketpy_comparison.py explains. Wanted: centres within three standard errors
and 1 % of the range, semi-axes of 1 sigma within 10 %.
"""

import argparse
import json
import math
import os
import sys
import tempfile
import time
from pathlib import Path

import calisto
import numpy as np
from rocketpy import Flight, MonteCarlo
from rocketpy.stochastic import (
    StochasticEnvironment,
    StochasticFlight,
    StochasticNoseCone,
    StochasticRailButtons,
    StochasticRocket,
    StochasticSolidMotor,
    StochasticTail,
    StochasticTrapezoidalFins,
)

from shefex_nav.campaign.impact import ellipses, landing
from shefex_nav.geometry import frames, wgs84
from shefex_nav.world.flight import fly, settings, start

EARTH = frames.EarthRotation(np.eye(3), np.eye(3), 0.0, wgs84.OMEGA)
SIGMAS = {"inclination": 1.0, "heading": 2.0, "impulse": 0.01, "drag": 0.05, "wind": 0.3}  # deg, deg, shares
CLOSE, RANGE_SHARE, AXES = 3.0, 0.01, 0.1
SITE = math.radians(calisto.LATITUDE), math.radians(calisto.LONGITUDE)


class Corrected(StochasticRocket):
    """A rocket that is made anew for each flight, with what RocketPy has the wrong way round put right."""

    def create_object(self):
        """rocketpy.Rocket"""
        made = super().create_object()
        for change in (calisto.turn_lever_arms, calisto.whole_jet_damping, calisto.steady_flow):
            change(made)
        return made


def by_rocketpy(flights, seed, folder):
    """(n, 2) m, north and east of the rail, of flights by RocketPy's Monte Carlo."""
    np.random.seed(seed)  # noqa: NPY002 parts of RocketPy draw from it
    rocket, env = calisto.rocket(), calisto.environment()
    impulse = rocket.motor.total_impulse
    motor = StochasticSolidMotor(
        solid_motor=rocket.motor, total_impulse=(impulse, SIGMAS["impulse"] * impulse)
    )
    factor = (1.0, SIGMAS["drag"])
    any_rocket = Corrected(rocket=rocket, power_off_drag_factor=factor, power_on_drag_factor=factor)
    any_rocket.add_motor(motor)  # places are those of the rocket where none is given
    nose, fins, tail = (surface for surface, _ in rocket.aerodynamic_surfaces)
    any_rocket.add_nose(StochasticNoseCone(nosecone=nose))
    any_rocket.add_trapezoidal_fins(StochasticTrapezoidalFins(trapezoidal_fins=fins))
    any_rocket.add_tail(StochasticTail(tail=tail))
    buttons = StochasticRailButtons(rail_buttons=rocket.rail_buttons[0].component)
    any_rocket.set_rail_buttons(buttons, lower_button_position=[-0.6182])
    winds = {f"wind_velocity_{axis}_factor": (1.0, SIGMAS["wind"]) for axis in "xy"}
    flight = Flight(
        rocket=rocket, environment=env, rail_length=calisto.RAIL_LENGTH, inclination=calisto.INCLINATION,
        heading=calisto.HEADING,
    )  # fmt: skip
    study = MonteCarlo(
        filename=str(folder / "calisto"),
        environment=StochasticEnvironment(environment=env, **winds),
        rocket=any_rocket,
        flight=StochasticFlight(
            flight=flight, inclination=(calisto.INCLINATION, SIGMAS["inclination"]),
            heading=(calisto.HEADING, SIGMAS["heading"]),
        ),
    )  # fmt: skip
    study.simulate(number_of_simulations=flights, append=False)
    return np.column_stack([study.results["y_impact"], study.results["x_impact"]])


def here(flights, seed):
    """(n, 2) m, the same of ours."""
    rng, given = np.random.default_rng(seed), calisto.flight_params(calisto.rocket())
    foot = wgs84.ecef_from_geodetic(*SITE, calisto.ELEVATION)
    return np.array([_landed(_drawn(given, rng), foot) for _ in range(flights)])


def _drawn(given, rng):
    """FlightParams of one flight."""
    inclination, heading, impulse, drag, *winds = rng.standard_normal(6)
    stage, site = given.stages[0], given.start
    k = 1.0 + SIGMAS["impulse"] * impulse
    motor = stage.motor._replace(
        vacuum_thrust_n=k * stage.motor.vacuum_thrust_n, exhaust_speed=k * stage.motor.exhaust_speed
    )
    aero = stage.aerodynamics._replace(axial=(1.0 + SIGMAS["drag"] * drag) * stage.aerodynamics.axial)
    there = settings.Launch(
        **{name: getattr(site, name) for name in ("latitude", "longitude", "height", "roll", "rail_length")},
        azimuth=site.azimuth + math.radians(SIGMAS["heading"] * heading),
        elevation=site.elevation + math.radians(SIGMAS["inclination"] * inclination),
    )
    wind = given.wind * [1.0, 1.0 + SIGMAS["wind"] * winds[0], 1.0 + SIGMAS["wind"] * winds[1]]
    return given._replace(stages=(stage._replace(motor=motor, aerodynamics=aero),), start=there, wind=wind)


def _landed(given, foot):
    """(2,) m, north and east of the foot of the rail."""
    world, _ = start.surround(given, EARTH)
    one = landing.last_landing("", fly.fly(given, EARTH, None).trajectory, world, calisto.ELEVATION)
    there = wgs84.ecef_from_geodetic(one.latitude, one.longitude, calisto.ELEVATION)
    return (wgs84.dcm_en(*SITE).T @ (there - foot))[:2]


def shape(places):
    """Centre (2,), its standard error (2,), semi-axes (2,), m, and azimuth, deg, of landings (n, 2) m."""
    metres = wgs84.ecef_from_geodetic(*SITE, 0.0)
    level = np.column_stack([places, np.zeros(len(places))]) @ wgs84.dcm_en(*SITE).T
    geodetic = np.array([wgs84.geodetic_from_ecef(metres + one)[:2] for one in level])
    one = ellipses.ellipse("", *geodetic.T)
    return places.mean(axis=0), np.array(one.error), np.array(one.axes), math.degrees(one.azimuth), one.inside


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--flights", type=int, default=800)
    parser.add_argument("--flights-rocketpy", type=int, metavar="N", help="default: as many as here")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE")
    asked = parser.parse_args()
    kept = asked.json and asked.json.resolve()  # RocketPy writes where it is, so that is a folder of its own
    theirs = asked.flights if asked.flights_rocketpy is None else asked.flights_rocketpy
    found, seconds = {}, {}
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name, function in (
            ("here", lambda: here(asked.flights, asked.seed)),
            ("RocketPy", lambda: by_rocketpy(theirs, asked.seed, Path(folder))),
        ):
            began = time.process_time()
            found[name] = function()
            seconds[name] = time.process_time() - began
    shapes = {name: shape(places) for name, places in found.items()}
    for name, (centre, error, axes, azimuth, inside) in shapes.items():
        print(
            f"{name:9s} {len(found[name])} flights, centre {centre[0]:.1f} m north ± {error[0]:.1f}, "
            f"{centre[1]:.1f} m east ± {error[1]:.1f}; 1 sigma {axes[0]:.1f} by {axes[1]:.1f} m at "
            f"{azimuth:.1f} deg; inside {inside}; {seconds[name]:.1f} s of processor time"
        )
    (centre, error, axes, *_), (other, other_error, other_axes, *_) = shapes.values()
    apart, allowed = centre - other, CLOSE * np.hypot(error, other_error) + RANGE_SHARE * np.hypot(*other)
    ratio = axes / other_axes
    print(
        f"centres apart {apart[0]:+.1f} m, {apart[1]:+.1f} m; allowed {allowed[0]:.1f} m, {allowed[1]:.1f} m"
    )
    print(f"semi-axes over RocketPy's {ratio[0]:.3f}, {ratio[1]:.3f}")
    if kept:
        kept.write_text(json.dumps({name: places.tolist() for name, places in found.items()}) + "\n")
    sys.exit(0 if (np.abs(apart) <= allowed).all() and (np.abs(ratio - 1.0) <= AXES).all() else 1)


if __name__ == "__main__":
    main()
