"""For how long the accelerometers sense the weight, and the errors of the IMU that are biases meanwhile.

Errors in proportion to specific force are noise to the filter unless their block is on, noise that keeps its
sign for `navigation.thrust_memory`: thrust ends soon. Weight does not. On the ground, on the launch pad and
under a parachute these errors are biases.
"""

# Memories that weight may last. After a time t an error s that stays has grown to s^2 t^2, noise with the
# memory tau to 2 s^2 tau t: as much at 2 tau, the burn for which tau is chosen, two thirds of it at 3 tau.
MEMORIES = 3.0


def errors(imu):
    """Blocks of the errors that go with specific force, and how large these are in the IMU of a scenario."""
    return {
        "gyro_g_sensitivity": imu.gyro.g_sensitivity,
        "accel_scale": imu.accelerometer.scale_factor,
        "accel_misalignment": imu.accelerometer.misalignment,
    }


def longest(scenario, events, end_s):
    """For how long weight lasts, as far as the flight was seen, and where: (s, text)."""
    return max(_times(scenario, {event.name: event.t_s for event in events}, end_s), default=(0.0, ""))


def is_bias(scenario, lasts_s):
    """Whether weight that lasts so long makes biases of the errors."""
    return lasts_s > MEMORIES * scenario.navigation.thrust_memory


def _times(scenario, at, end_s):
    """Each time that weight acts: (s, where). at : {event: s}"""
    start_s = scenario.mission.start
    if scenario.ground is not None:
        yield end_s - start_s, "the vehicle stands on the ground"
    if scenario.launch is not None or (scenario.trajectory is not None and "lift_off" in at):
        yield at.get("lift_off", min(end_s, 0.0)) - start_s, "the vehicle stands on the pad"
    if "parachute" in at:
        yield at.get("impact", end_s) - at["parachute"], "the vehicle hangs on its parachute"
