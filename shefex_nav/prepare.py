"""Everything that is settled before the first tick: the flight, and what the sensors will say of it."""

from itertools import chain
from typing import NamedTuple

import numpy as np

from shefex_nav import __version__
from shefex_nav.environment import ephemeris, gnss, stars, yuma
from shefex_nav.geometry import frames, wgs84
from shefex_nav.instruments import faults as instrument_faults
from shefex_nav.instruments.instrument import Truth
from shefex_nav.log.topics import Mission
from shefex_nav.onboard import computer as onboard
from shefex_nav.records import Alignment, Phase
from shefex_nav.scenario import (
    aboard,
    lens,
    load,
    params,
    params_onboard,
    plugged,
    software,
    surroundings,
    wanted_states,
)
from shefex_nav.scenario.block import AUTOMATIC
from shefex_nav.scenario.of_settings import settings
from shefex_nav.scenario.told import as_told
from shefex_nav.world import absent, camera, faults, gps, imu, noise, pad
from shefex_nav.world.fault_settings import Faults
from shefex_nav.world.flight import fly
from shefex_nav.world.flight.record import MEMORY

BRIEF_S = 5.0  # of a flight that nobody waits for
PLANNED = 1  # seed of the planned flight
BEGIN_S = 900.0  # of an orbit that is looked at before it is flown


class World(NamedTuple):
    """The world of one run."""

    earth: object  # EarthRotation
    catalogue: object  # StarCatalogue at the epoch of its data
    flight: fly.Flight
    alignment: Alignment
    imu: object  # ImuData
    gps_fixes: list
    camera: camera.Camera
    computer: onboard.ComputerParams
    gps_ranges: list
    faults: Faults
    imu_biases: np.ndarray | None = None  # (N, 6) rad/s, m/s^2, if they are wanted
    measured: dict = {}  # noqa: RUF012 a default is not changed; name of an instrument -> instrument.Measured

    @property
    def received(self):
        """What GPS receiver and instruments say, in no order: list."""
        others = (one.readings for one in self.measured.values())
        return [*self.gps_fixes, *self.gps_ranges, *chain(*others)]


class Healthy(NamedTuple):
    """What the sensors of a run have before any of them fails."""

    scenario: object  # Scenario, `settled`; of its faults nothing is looked at
    seed: int
    world: World  # without what sensors say and how they fail
    sensed: imu.Sensed
    gps: gps.GpsData


def build_world(scenario, seed, *, brief=False, flight=None, biases=False, room=MEMORY):
    """Fly the vehicle and let the sensors measure it.

    Parameters
    ----------
    scenario : Scenario
    seed : int
    brief : of an orbit, or of a vehicle that stands on the ground, the first seconds alone; a launched one
        flies to its end either way
    flight : a Flight of the same vehicle that has been flown already, if there is one
    biases : whether to keep the true biases of the IMU at every sample, `true_biases`
    room : record.Memory, where the truth lies

    Returns
    -------
    World
    """
    aboard.activate(scenario)
    if flight is None:
        flight = fly_vehicle(scenario, seed, brief=brief, room=room)
        room.release()
    wanted = np.empty((len(flight.trajectory.t_s), 6)) if biases else None
    healthy = measure(scenario, seed, flight, brief=brief, biases=wanted, room=room)
    found = with_faults(scenario, healthy)
    room.release()
    return found


def measure(scenario, seed, flight, *, brief=False, biases=None, sky=None, room=MEMORY):
    """Let the sensors measure a flight; which of them fail is not looked at yet, `with_faults`.

    Parameters
    ----------
    scenario, seed, flight, brief : as of `build_world`
    biases : (N, 6), written if it is given: the true biases of the IMU at every sample
    sky : gps.Sky of the flight, if it is there already
    room : record.Memory, where the truth of the flight lies

    Returns
    -------
    Healthy
    """

    aboard.activate(scenario)
    scenario = settled(scenario, flight if brief else None)
    world = unmeasured(scenario, seed, flight)
    unit, shaken = _unit(scenario), absent.VIBRATION not in scenario.without
    sensed = imu.sense(unit, flight.trajectory, noise.generator(seed, "imu"), biases, shaken)
    room.release()
    receiver, start_s = settings(scenario.gps), yuma.gps_seconds(scenario.mission.epoch)
    seen = gps_sky(scenario, flight) if sky is None else sky
    room.release()
    rngs = noise.generator(seed, "gps"), noise.generator(seed, "gps_errors")
    said = gps.received(receiver, seen, flight.events, start_s, *rngs, scenario.without)
    return Healthy(scenario, seed, world._replace(imu_biases=biases), sensed, said)


def unmeasured(scenario, seed, flight):
    """World of a flight in which nothing has measured yet. scenario : `settled` -> World"""
    earth, bodies = earth_rotation(scenario), ephemeris.sky_bodies(scenario.mission.epoch)
    catalogue = stars.load_catalogue(8.0)
    at_epoch = stars.at_epoch(catalogue, ephemeris.julian_year(scenario.mission.epoch))
    rng = noise.generator(seed, "camera_errors")
    of_camera = absent.of_camera(settings(scenario.star_camera), scenario.without)
    true_camera = camera.init(of_camera, at_epoch, bodies, earth, rng)
    rng, unknown = noise.generator(seed, "pad"), settings(scenario.pad_alignment)
    return World(
        earth=earth,
        catalogue=catalogue,
        flight=flight,
        alignment=pad.align(unknown, flight.trajectory, earth, rng, scenario.without),
        imu=None,
        gps_fixes=[],
        gps_ranges=[],
        camera=true_camera,
        computer=params_onboard.computer_params(scenario, bodies, true_camera.bad_pixel_map),
        faults=None,
        imu_biases=None,
    )


def with_faults(scenario, healthy, *, keeps=False):
    """The world of a run in which the sensors fail as a scenario says.

    scenario : the Scenario of a Healthy, or one that differs from it by its faults
    keeps : whether the Healthy is to be used again; else its arrays are used up
    -> World
    """
    world, sensed, receiver = healthy.world, healthy.sensed, settings(healthy.scenario.gps)
    flight, wrong, of_instruments = world.flight, settings(scenario.faults), aboard.wrong(scenario)
    if keeps:
        sensed = sensed._replace(dtheta_b=sensed.dtheta_b.copy(), dv_b=sensed.dv_b.copy())
    fixes = gps.as_kind(faults.gps(wrong.gps, healthy.gps.fixes), receiver.fix)
    ranges = healthy.gps.ranges
    if ranges:
        ranges = faults.gps_ranges(wrong.gps, ranges, healthy.gps.antenna)
    events = [*flight.events, *faults.events(wrong, flight.trajectory, world.earth, of_instruments)]
    seen = flight.trajectory, world.earth
    return world._replace(
        flight=flight._replace(events=tuple(sorted(events, key=lambda event: event.t_s))),
        imu=imu.reported(_unit(healthy.scenario), flight.trajectory.t_s, sensed, wrong.imu),
        gps_fixes=gps.stamped(fixes, receiver.clock_offset),
        gps_ranges=gps.stamped(ranges, receiver.clock_offset),
        faults=wrong,
        measured=measured_by_instruments(healthy.scenario, healthy.seed, *seen, of_instruments),
    )


def _unit(scenario):
    """world.settings.Imu of the unit that is flown, which may lack errors that all on board counts with."""
    return absent.of_imu(settings(scenario.imu), scenario.without)


def gps_sky(scenario, flight, with_ranges=True):
    """gps.Sky of a flight: `measure` of all runs of it needs no other. with_ranges : as of `gps.sky`"""
    receiver, satellites = settings(scenario.gps), constellation(scenario)
    return gps.sky(receiver, flight.trajectory, earth_rotation(scenario), satellites, with_ranges)


def settled(scenario, flight=None, moved=None, room=MEMORY):
    """The Scenario with the names of the blocks that its filter estimates, if it leaves them to the program.

    flight : the planned one, if it has been flown already; it does not depend on the run
    moved : its wanted_states.Motion, if that is there, which is kept for other scenarios
    room : record.Memory of one that has to be flown
    """
    return settled_with_effects(scenario, flight, moved, room)[0]


def settled_with_effects(scenario, flight=None, moved=None, room=MEMORY):
    """The same, and why these blocks: list of wanted_states.Effect, empty if the scenario names them."""
    if scenario.navigation.states != AUTOMATIC:
        return scenario, []
    effects = wanted(scenario, flight, moved, room)
    return load.with_states(scenario, [one.block for one in effects if one.on]), effects


def wanted(scenario, flight=None, moved=None, room=MEMORY):
    """list of wanted_states.Effect of a scenario, by its planned flight; arguments as of `settled`."""
    if flight is None:
        flight = fly_vehicle(scenario, PLANNED, room=room)
    if moved is None:
        moved = wanted_states.motion(flight.trajectory)
    return wanted_states.effects(as_told(scenario), moved, flight.events, float(flight.trajectory.t_s[-1]))


def measured_by_instruments(scenario, seed, trajectory, earth, wrong):
    """What the instruments aboard say of a flight: {name: instrument.Measured}. wrong : `aboard.wrong`"""
    found = [(one, settings(given)) for one, given in aboard.instruments(scenario)]
    if not found:
        return {}
    seen = truth(scenario, trajectory, earth)
    streams = {one.name: noise.key_of(one.name) if one.stream is None else one.stream for one, _ in found}
    said = {}
    for one, given in found:
        healthy = one.measure(given, seen, noise.generator(seed, streams[one.name]))
        said[one.name] = instrument_faults.applied(one, given, wrong[one.name], healthy)
    return said


def truth(scenario, trajectory, earth):
    """What instruments may look at. -> instrument.Truth"""
    sun_i = ephemeris.apparent_sun(ephemeris.sky_bodies(scenario.mission.epoch))
    at = None
    if scenario.trajectory is not None:
        from shefex_nav.trajectory import flight as given_flight

        at = given_flight.begins_at(trajectory, earth)
    return Truth(trajectory, earth, aboard.year(scenario), sun_i, surroundings.air(scenario, at))


def fly_vehicle(scenario, seed, *, brief=False, room=MEMORY):
    """The flight alone, without sensors; arguments as of `build_world`. -> Flight"""
    if scenario.trajectory is not None:
        from shefex_nav.trajectory import flight as given_flight  # its splines are SciPy's, half a second

        return given_flight.fly(scenario, earth_rotation(scenario))
    flight_params = params.flight_params(scenario)
    if brief and scenario.launch is None:
        flight_params = flight_params._replace(time_limit_s=flight_params.t_start_s + BRIEF_S, programme=())
    rng = noise.generator(seed, "attitude_control")
    return fly.fly(flight_params, earth_rotation(scenario), rng, room)


def fly_begin(scenario, seed):
    """The first BEGIN_S of a flight in orbit, without sensors. -> Flight"""
    flight_params = params.flight_params(scenario)._replace(time_limit_s=begin_until(scenario))
    return fly.fly(flight_params, earth_rotation(scenario), noise.generator(seed, "attitude_control"))


def begin_until(scenario):
    """Mission time until which `fly_begin` flies, s."""
    mission = scenario.mission
    return min(mission.time_limit, mission.start + BEGIN_S)


def constellation(scenario):
    """The GPS satellites of a scenario: those of its almanac, or the nominal ones. -> gnss.Constellation"""
    if scenario.gps.almanac is None:
        return gnss.nominal_24(scenario.mission.epoch)
    return yuma.constellation(params.almanac(scenario), scenario.mission.epoch)


def mission(scenario, seed, trajectory):
    """Who, when and where, for the head of a log. Scenario, int, Trajectory -> Mission.

    Drawings are in axes of the launch site, or of the point on the ellipsoid below the start of an orbit.
    """
    earth, t_s = earth_rotation(scenario), float(trajectory.t_s[0])
    bent = lens.distortion_of(scenario.star_camera)
    r_e, _ = frames.ecef_from_inertial(earth, t_s, trajectory.r_i[0], trajectory.v_i[0])
    latitude, longitude, height = wgs84.geodetic_from_ecef(r_e)
    return Mission(
        scenario=scenario.mission.name,
        scenario_text=scenario.source,
        seed=seed,
        version=__version__,
        epoch_utc=scenario.mission.epoch,
        start_s=scenario.mission.start,
        earth=earth,
        launch_latitude=latitude,
        launch_longitude=longitude,
        launch_height=height if _from_the_ground(scenario, trajectory) else 0.0,
        camera=params_onboard.nominal_camera(scenario),
        C_bc=params.mounting(scenario),
        sun_i=ephemeris.sky_bodies(scenario.mission.epoch).sun_u_i,
        sun_exclusion=scenario.star_camera.stray_light.sun_exclusion,
        limb_exclusion=scenario.star_camera.stray_light.earth_exclusion,
        plugins=plugged.pinned(scenario),
        software=software.flown(scenario),
        distortion=() if bent is None else tuple(bent.tolist()),
    )


def _from_the_ground(scenario, trajectory):
    """Whether the flight starts on the ground."""
    given = scenario.trajectory is not None
    return trajectory.phase[0] == Phase.PAD if given else scenario.orbit is None


def earth_rotation(scenario):
    """EarthRotation of the scenario's epoch and pinned Earth orientation."""
    earth = scenario.earth
    return ephemeris.earth_rotation(scenario.mission.epoch, earth.ut1_minus_utc, earth.pole_x, earth.pole_y)


def true_biases(scenario, seed, trajectory):
    """Turn-on and in-run bias of gyros and accelerometers at every sample: (N, 6) rad/s, m/s^2.

    The instrument is asked again, with the same random numbers.
    """
    biases = np.empty((len(trajectory.t_s), 6))
    imu.measure(_unit(scenario), trajectory, noise.generator(seed, "imu"), biases)
    return biases
