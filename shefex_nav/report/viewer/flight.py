"""Curves of the flight: height, speed, roll, what the attitude control does; the phases as a lane."""

import numpy as np

from shefex_nav.records import Phase
from shefex_nav.report.local_level import is_replay
from shefex_nav.report.track import earth_fixed
from shefex_nav.report.viewer import world
from shefex_nav.report.viewer.sender import WHITE, YELLOW, plot_step


def send(sender, data):
    """Everything of one run."""
    motion(sender, data)
    control(sender, data)
    if is_replay(data):  # recorded data do not say the phases
        return
    phases = {phase.name.lower(): colour for phase, colour in world.PHASE_COLOURS.items()}
    states = [Phase(p).name.lower() for p in data.truth.phase]
    sender.lane("states/phase", data.truth.t_s, states, phases, world.time_span(data))


def motion(sender, data):
    """Height, speed against the Earth, roll rate."""
    every = world.thinned(data.truth, plot_step(data.truth.t_s))
    track = earth_fixed(data.mission.earth, every)
    sender.curve("plots/height", every.t_s, track.height / 1e3, WHITE, "height [km]")
    speed = np.linalg.norm(track.v_e, axis=1)
    sender.curve("plots/speed", every.t_s, speed, YELLOW, "speed [m/s]")
    roll_rate = np.degrees(every.omega_ib_b[:, 0])  # NaN in the truth of external data
    sender.curve("plots/roll_rate", every.t_s, roll_rate, (150, 200, 255), "roll rate [deg/s]")


def control(sender, data):
    """Pointing error about each axis, and the gas."""
    if len(data.control.t_s):
        sender.axes("plots/pointing", data.control.t_s, np.degrees(data.control.pointing_error))
        sender.curve("plots/gas", data.control.t_s, data.control.propellant_kg, WHITE, "gas [kg]")
