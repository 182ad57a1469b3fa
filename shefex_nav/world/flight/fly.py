"""Fly the mission: from the parameters of vehicle, start and programme to the truth at the IMU rate.

In: `FlightParams`, `EarthRotation`, random numbers for the errors of the attitude reference. Out: `Flight`.

The flight is a chain of sections, each integrated with one configuration, one kind of motion (on the rail,
free, steered by cold gas, prescribed) and one task. They end at the moments of the timeline, and where the
integration finds an end of its own: of the rail, at the height of the parachute, on the ground.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_EVENT_S as EPS
from shefex_nav.geometry import rotation
from shefex_nav.records import Trajectory
from shefex_nav.world.flight import attitude_program as attitude
from shefex_nav.world.flight import (
    control,
    devices,
    dynamics,
    events,
    settings,
    start,
    surroundings,
    tasks,
    timeline,
    vehicle,
)
from shefex_nav.world.flight import params as p
from shefex_nav.world.flight.integrate import STOP, T_END, TOLERANCE, MotionError, Vehicle, integrate
from shefex_nav.world.flight.record import MEMORY, Record
from shefex_nav.world.flight.timeline import FlightError, Kind

REVERSED = 0.5  # share of the spin beyond which a yo-yo must not leave it the other way round
STOPPED = 0.01  # rad/s; slower than that a yo-yo does not unwind


class ControlHistory(NamedTuple):
    """The attitude control as flown: arrays over its M ticks."""

    t_s: np.ndarray  # (M,)
    pointing_error: np.ndarray  # (M, 3) rad, body axes: wanted attitude -> true one; NaN where none is wanted
    torque_b: np.ndarray  # (M, 3) N m, until the next tick
    propellant_kg: np.ndarray  # (M,) used so far


class Dropped(NamedTuple):
    """A stage as it is left behind: its centre of mass."""

    stage: int  # number, from 0
    t_s: float
    r_i: np.ndarray  # (3,) m
    v_i: np.ndarray  # (3,) m/s


class Flight(NamedTuple):
    """A flight as flown."""

    trajectory: Trajectory
    events: tuple  # of Event in order of time
    control: ControlHistory | None  # None: nothing was steered by cold gas
    dropped: tuple = ()  # of Dropped in order of time


def fly(params, earth, rng=None, room=MEMORY):
    """Fly the mission once.

    Parameters
    ----------
    params : FlightParams
    earth : EarthRotation
    rng : numpy Generator of the errors of the attitude reference; None: it has no errors
    room : record.Memory, where the truth lies

    Returns
    -------
    Flight
    """
    timeline.check(params)
    world, q_eb = start.surround(params, earth)
    dt = 1.0 / params.sample_rate_hz
    n = int(np.floor((params.time_limit_s - params.t_start_s) / dt + 1e-6)) + 1
    record = Record(params.t_start_s, dt, n, room)
    if isinstance(params.start, settings.Ground):
        _, n = start.stand(params, world, q_eb, params.payload.mass, record, params.time_limit_s + dt)
        return _flight(params, earth, record.until(n), {}, None, False)
    steering = control.none() if params.cold_gas is None else _steering(params, rng)
    run = _at_the_start(params, world, q_eb, record, steering)
    run.to_the_end()
    history = None
    if params.cold_gas is not None and params.programme and params.attitude == p.FLOWN:
        h = steering.history[: steering.count[0]]
        history = ControlHistory(h[:, 0].copy(), h[:, 1:4].copy(), h[:, 4:7].copy(), h[:, 7].copy())
        empty = h[:, 7] >= params.cold_gas.propellant * (1.0 - 1e-12)
        if empty.any():
            run.instants["cold_gas_empty"] = h[np.argmax(empty), 0]
    flight = _flight(params, earth, record.until(run.k), run.instants, history, run.landed)
    return flight._replace(dropped=tuple(run.dropped))


def _at_the_start(params, world, q_eb, record, steering):
    """The run at lift-off, the time on the pad behind it, or in orbit: `_Run`."""
    vehicles = configurations(params)
    if isinstance(params.start, settings.Orbit):
        t_start = float(params.t_start_s)
        x = start.orbit(params, lever(vehicles[0], t_start))
        return _Run(params, world, record, vehicles, steering, _Begin(x, t_start, 0, dynamics.FREE))
    lift_off = timeline.burns(params)[0].t_0
    x, k = start.stand(params, world, q_eb, vehicles[0].mass[-1, 1], record, lift_off)
    begin = _Begin(x, lift_off, k, dynamics.ON_RAIL)
    run = _Run(params, world, record, vehicles, steering, begin)
    run.instants["lift_off"] = lift_off
    if lift_off > 0.0:
        run.instants["ignition_1"] = lift_off
    return run


def configurations(params):
    """The vehicle after 0, 1, 2 ... separations: tuple of `vehicle.Configuration`."""
    stages, out = params.stages, []
    for n, stage in enumerate(stages):
        above = [vehicle.charge(other.propellant, -1) for other in stages[n + 1 :]]
        rigid = [params.payload, *(other.dry for other in stages[n:]), *above]
        out.append(vehicle.configure(rigid, stage, params, stage.aerodynamics))
    if not stages or stages[-1].separation is not None:
        out.append(vehicle.configure([params.payload], None, params, params.payload_aerodynamics))
    motors = devices.spin_motor_rows(params.spin_motors)
    t_0, t_1 = timeline.prescribed(params)
    if params.spin_motors is not None and t_0 - EPS <= params.spin_motors.at < t_1 - EPS:
        motors = devices.spin_motor_rows(None)  # the attitude happens as told
    parachute, none = devices.parachute_row(params.parachute), devices.yo_yo_row(None, 0.0, 1.0)
    return tuple(c._replace(spin_motors=motors, parachute=parachute, yo_yo=none) for c in out)


def lever(configuration, t_s):
    """(3,) m from the IMU to the centre of mass at t_s, body axes."""
    station = _mass_row(configuration, t_s)[2]
    return np.array([-station, *configuration.offset]) - configuration.imu


def _mass_row(configuration, t_s):
    """(6,) propellant, mass, station and inertia at t_s."""
    left = np.interp(t_s, configuration.thrust[:, 0], configuration.thrust[:, 2])
    table = configuration.mass
    return np.array([np.interp(left, table[:, 0], column) for column in table.T])


def _steering(params, rng):
    """The control, with room for the ticks of all tasks."""
    seconds = [task.end - task.start for _, task in params.programme]
    ticks = sum(int(s / params.cold_gas.period) + 3 for s in seconds) + 3  # and where sections are cut
    return control.start(params.cold_gas, rng, ticks)


class _Begin(NamedTuple):
    """Where the integration begins."""

    x: np.ndarray  # (19,) state
    t_s: float
    k: int  # number of the first sample
    mode: int  # of the attitude, as in `dynamics`


class _Run:
    """The flight while it is flown: state, what is attached, who steers."""

    def __init__(self, params, world, record, vehicles, steering, begin):
        self.params, self.world, self.record = params, world, record
        self.vehicles, self.steering = vehicles, steering
        self.x, self.t_s, self.k, self.mode = begin
        self.configuration, self.law = vehicles[0], attitude.hold(0.0, 1.0, 0.0)
        self.instants, self.landed, self.dropped = {}, False, []
        self.moments = timeline.moments(params)
        self.unsteered = control.none()
        self.wanted_until = -np.inf  # s, up to when the control's wanted attitude has been carried on
        self.gathered = 0  # samples whose drift the attitude reference has gathered
        self.stop_height = -np.inf if params.parachute is None else params.parachute.opens_below

    def to_the_end(self):
        """Fly through all moments until the ground or the time limit."""
        for n, moment in enumerate(self.moments):
            self._until(moment.t_s, moment)
            self._do(moment, self.moments[n + 1 :])
        self._until(self.params.time_limit_s + 0.5 / self.params.sample_rate_hz, None)  # with its sample
        if isinstance(self.params.start, settings.Launch) and not self.landed:
            limit = self.params.time_limit_s
            raise FlightError(
                f"the vehicle is still in the air at the time limit, {limit:g} s; mission.time_limit has to "
                "allow for all of its descent (run --until shows a part of a flight)"
            )
        if self.landed and np.isfinite(self.stop_height):
            height = 1e-3 * self.stop_height
            raise FlightError(
                f"the parachute never opens: the vehicle does not come down through {height:g} km"
            )

    def _until(self, t_end, waiting):
        """Integrate to t_end; `waiting`: the moment that is due then, None: nothing."""
        while self.t_s < t_end - EPS and not self.landed:
            event = self._section(float(t_end))
            if event == T_END:
                if self.mode == dynamics.ON_RAIL:
                    words = f"the vehicle is still on the rail at T+{t_end:.1f} s"
                    raise FlightError(words, timeline.key_of(self.params, waiting))
            elif event == STOP:
                self._open_parachute()
            elif self.mode == dynamics.ON_RAIL:
                self.instants["rail_exit"], self.mode = self.t_s, dynamics.FREE
            elif waiting is not None:
                words = f"the vehicle hits the ground at T+{self.t_s:.1f} s, before {waiting.name}"
                raise FlightError(words, timeline.key_of(self.params, waiting))
            else:
                self.instants["impact"], self.landed = self.t_s, True

    def _section(self, t_end):
        """Integrate one section: event as `integrate` gives it."""
        steering = self.steering if self.mode == dynamics.CONTROLLED else self.unsteered
        steering = steering._replace(stop_height=self.stop_height)
        flown = Vehicle(self.configuration, self.mode, self.law, steering)
        begin = self.t_s
        try:
            self.t_s, self.k, event = integrate(
                self.x, begin, t_end, self.k, self.record.samples, flown, self.world, TOLERANCE
            )
        except MotionError as error:
            raise FlightError(
                f"{error}; look at the coefficients, the centre of pressure, the inertias and the torques"
            ) from None
        if self.mode == dynamics.PROGRAMMED:
            self.x[10:13] = attitude.body_rate(self.law, self.t_s)[:3]
            self._check_height()
        elif self.mode == dynamics.CONTROLLED:
            self.gathered = self.k
        return event

    def _check_height(self):
        """Where the attitude is prescribed nothing stops the integration: look afterwards."""
        height = start.height(self.world, self.t_s, self.x[:3])
        if height < max(0.0, self.stop_height) and self.x[:3] @ self.x[3:6] < 0.0:
            what = "hits the ground" if height < 0.0 else "passes the height of its parachute"
            raise FlightError(f"the vehicle {what} before T+{self.t_s:.1f} s, its attitude still prescribed")

    def _do(self, moment, later):
        """What happens at a moment; `later`: the moments after it."""
        prescribed_0, prescribed_1 = timeline.prescribed(self.params)
        as_told = prescribed_0 - EPS <= moment.t_s < prescribed_1 - EPS and self.mode == dynamics.PROGRAMMED
        self.instants[moment.name] = moment.t_s
        if moment.kind == Kind.BEGIN and self.mode == dynamics.ON_RAIL:
            words = f"{moment.name} is due at T+{moment.t_s:.1f} s, on the launch rail"
            raise FlightError(words, timeline.key_of(self.params, moment))
        match moment.kind:
            case Kind.END:
                self._end(moment, later)
            case Kind.SEPARATION:
                self._separate(self.params.stages[moment.number - 1], moment.number, as_told)
            case Kind.YO_YO if as_told:
                del self.instants[moment.name]
            case Kind.YO_YO:
                self._release_yo_yo()
            case Kind.SPIN_MOTORS if not len(self.configuration.spin_motors):
                del self.instants[moment.name]
            case Kind.BEGIN if self.params.attitude == p.FLOWN:
                self._begin(self.params.programme[moment.number][1])
            case Kind.BEGIN:
                self._prescribe(*self.params.programme[moment.number])

    def _separate(self, stage, number, as_told):
        """Leave a stage behind; a prescribed attitude is not disturbed by it."""
        before, after = self.configuration, self.vehicles[number]
        if before.yo_yo[0] <= self.t_s < before.yo_yo[1] - EPS:
            until = f"until T+{before.yo_yo[1]:.2f} s"
            raise FlightError(f"separation_{number} is due while the yo-yo unwinds, {until}")
        lever_b = np.array([-stage.dry.station, *before.offset]) - before.imu
        v_b = np.cross(self.x[10:13], lever_b) - [stage.separation.impulse / stage.dry.mass, 0.0, 0.0]
        r_i, v_i = self.x[0:3] + self._C_ib() @ lever_b, self.x[3:6] + self._C_ib() @ v_b
        self.dropped.append(Dropped(number - 1, self.t_s, r_i, v_i))
        self.configuration = after._replace(yo_yo=before.yo_yo, parachute=before.parachute)
        speed = stage.separation.impulse / _mass_row(after, self.t_s)[1]
        rate = np.zeros(3) if as_told else np.array([0.0, *stage.separation.tip_off])
        devices.kick(self.x, self._C_ib(), speed, rate, lever(after, self.t_s))

    def _release_yo_yo(self):
        """Let the masses go; the law of their unwinding depends on the spin now."""
        spin = self.x[10]
        if abs(spin) < STOPPED:
            words = f"the yo-yo is released at T+{self.t_s:.1f} s, and the vehicle does not spin"
            raise FlightError(words, ("vehicle", "yo_yo", "at"))
        row = devices.yo_yo_row(self.params.yo_yo, spin, _mass_row(self.configuration, self.t_s)[3])
        left = devices.spin_left(row)
        if left < -REVERSED:
            words = f"the cords of the yo-yo are too long: they would turn {spin:.2f} rad/s into "
            raise FlightError(f"{words}{left * spin:.2f} rad/s", ("vehicle", "yo_yo", "cord_length"))
        self.configuration = self.configuration._replace(yo_yo=row)
        self.instants["yo_yo_off"] = row[1]

    def _open_parachute(self):
        """The height of the parachute has been passed on the way down."""
        row = devices.parachute_row(self.params.parachute, self.t_s)
        self.configuration = self.configuration._replace(parachute=row)
        self.instants["parachute"], self.stop_height = self.t_s, -np.inf

    def _end(self, moment, later):
        """A task is over: free, or held until the next one where the attitude is prescribed."""
        if self.params.attitude == p.FLOWN:
            self.wanted_until, self.mode = self.t_s, dynamics.FREE
            self.steering.torque[:] = 0.0
            return
        following = [m for m in later if m.kind == Kind.BEGIN]
        self.mode = dynamics.PROGRAMMED if following else dynamics.FREE
        if following and following[0].t_s > moment.t_s:
            self.law = attitude.hold(moment.t_s, following[0].t_s, self.x[10])

    def _prescribe(self, name, task):
        """Begin a task whose attitude is prescribed."""
        spin, row = self.x[10], _mass_row(self.configuration, self.t_s)
        if isinstance(task, tasks.LOOKS) and abs(spin) > control.SPINNING:
            words = f"the vehicle spins with {spin:.1f} rad/s when {name} begins"
            raise FlightError(words, ("programme", name, "from"))
        if isinstance(task, tasks.Damp):
            self.law = attitude.damp(task.start, task.end, self.x[10:13], (row[3] / row[4] - 1.0) * spin)
        else:
            self.law = self._rate_law(task, self.x[6:10].copy(), spin)
        self.mode = dynamics.PROGRAMMED
        # rates that the law does not take over are gone at once; the centre of mass is not moved by it
        jump = np.array(attitude.body_rate(self.law, self.t_s)[:3]) - self.x[10:13]
        devices.kick(self.x, self._C_ib(), 0.0, jump, lever(self.configuration, self.t_s))

    def _begin(self, task):
        """Begin a task flown by cold gas."""
        c, x = self.steering, self.x
        self._gather_drift()
        control.settle(c, self.record.columns.omega_ib_b[self.k - self._last_revolutions() : self.k])
        spinning = abs(x[10]) > control.SPINNING
        if isinstance(task, tasks.Damp):
            follow = control.RATES
        elif isinstance(task, tasks.SpinTo):
            follow = control.AXIS_AND_SPIN
        elif spinning and isinstance(task, tasks.Turn | tasks.AlignVelocity | tasks.Hold):
            follow = control.AXIS
        else:
            follow = control.ATTITUDE
        # a task that follows another goes on from what was wanted there, if that says enough
        told = c.follow == control.ATTITUDE or (follow != control.ATTITUDE and c.follow != control.RATES)
        if not (told and abs(self.wanted_until - self.t_s) < EPS):
            c.q_wanted[:] = control.estimated_attitude(c, x[6:10].copy())
            c.owed[:] = 0.0
        spin = x[10] if follow == control.AXIS_AND_SPIN else 0.0
        law = attitude.hold(task.start, task.end, 0.0)
        if follow != control.RATES:
            law = self._rate_law(task, c.q_wanted.copy(), spin)
        self.steering = c._replace(follow=follow, law=law)
        c.clock[0], c.next_s[0], c.awake[0] = self.t_s, self.t_s, False
        self.mode = dynamics.CONTROLLED

    def _last_revolutions(self):
        """Number of samples over which the control takes the mean rate."""
        seconds = 2.0 * np.pi * control.REVOLUTIONS / max(abs(self.x[10]), control.SPINNING)
        return min(self.k, round(seconds * self.params.sample_rate_hz))

    def _gather_drift(self):
        """Let the attitude reference drift over the samples since it was last used."""
        c, columns, new = self.steering, self.record.columns, slice(self.gathered, self.k)
        dt = 1.0 / self.params.sample_rate_hz
        c.tilt_i[:] += control.drift_over(columns.q_ib[new], columns.dtheta_b[new], dt, c.drift, c.roll_scale)
        self.gathered = self.k

    def _rate_law(self, task, q_ib, spin):
        """The law of a task from an attitude (4,), spinning at `spin` rad/s."""

        def ahead(t_s):
            return surroundings.free_fall(self.world, self.t_s, self.x[0:3], self.x[3:6], float(t_s))

        return attitude.rate_law(task, q_ib, spin, ahead, self.world.earth, self.params.C_bc)

    def _C_ib(self):
        return rotation.dcm_from_quat(self.x[6:10])


def _flight(params, earth, columns, instants, history, landed):
    """Flight of the record.Columns of its samples."""
    *motion, (mass, mach, pressure, thrust, height, attack) = columns
    t_s = params.t_start_s + np.arange(len(columns.r_i)) / params.sample_rate_hz
    stage = events.burning(params, t_s)
    if not isinstance(params.start, settings.Ground):
        for burn in timeline.burns(params):
            instants[f"burn_out_{burn.number}"] = burn.t_1
        launch = isinstance(params.start, settings.Launch)
        instants |= events.found(launch, t_s, height, pressure, landed)
    instants = {name: t for name, t in instants.items() if t <= max(t_s[-1], instants.get("impact", -np.inf))}
    trajectory = Trajectory(
        t_s,
        events.phases(params, t_s, stage, instants),
        *(*motion, mass, mach, pressure, thrust),
        burning=stage,
        angle_of_attack=attack,
    )
    return Flight(trajectory, events.describe(trajectory, height, earth, instants), history)
