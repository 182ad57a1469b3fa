"""Blocks of `navigation.states` that are missing: of errors that last in a flight, noise to the filter.

Errors in proportion to specific force are noise to the filter unless their block is on, noise that keeps its
sign for `navigation.thrust_memory`: thrust ends soon. Weight does not. On the ground, on the launch pad and
under a parachute these errors are biases, and the filter's covariance does not hold
(docs/theory/filter.md, docs/verification.md). Not looked at: what falls through the air without a parachute,
and that one which opens at a great height hangs in free fall first.
"""

from shefex_nav.onboard.navigation.blocks import OPTIONAL

# Memories that weight may last. After a time t an error s that stays has grown to s^2 t^2, noise with the
# memory tau to 2 s^2 tau t: as much at 2 tau, the burn for which tau is chosen, two thirds of it at 3 tau.
MEMORIES = 3.0


def words(scenario, flown):
    """What `navigation.states` lacks for the flight of a programme.Flown, in one line; "" if nothing."""
    navigation = scenario.navigation
    lasts_s, where = max(_under_weight(scenario, flown), default=(0.0, ""))
    missing = [
        name for name, sigma in _errors(scenario.imu).items() if sigma and name not in navigation.states
    ]
    if lasts_s <= MEMORIES * navigation.thrust_memory or not missing:
        return ""
    whole = [name for name in OPTIONAL if name in missing or name in navigation.states]
    are, errors_are, them = (
        ("are", "these errors are biases", "them") if missing[1:] else ("is", "this error is a bias", "it")
    )
    return (
        f"{_listed(missing)} {are} missing: {where} for {lasts_s:.0f} s, in which {errors_are} of the IMU; "
        f"the filter takes {them} for noise with a memory of {navigation.thrust_memory:g} s, so that its "
        f"sigmas are wrong; write states: [{', '.join(whole)}]"
    )


def _errors(imu):
    """Blocks of the errors that go with specific force, and how large these are in the IMU of a scenario."""
    return {
        "gyro_g_sensitivity": imu.gyro.g_sensitivity,
        "accel_scale": imu.accelerometer.scale_factor,
        "accel_misalignment": imu.accelerometer.misalignment,
    }


def _under_weight(scenario, flown):
    """For how long the vehicle feels its weight, as far as the flight was seen: (s, where) of each time."""
    start_s, at = scenario.mission.start, {event.name: event.t_s for event in flown.events}
    if scenario.ground is not None:
        yield flown.end_s - start_s, "the vehicle stands on the ground"
    if scenario.launch is not None:
        yield at.get("lift_off", min(flown.end_s, 0.0)) - start_s, "the vehicle stands on the pad"
    if "parachute" in at:
        yield at.get("impact", flown.end_s) - at["parachute"], "the vehicle hangs on its parachute"


def _listed(names):
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)
