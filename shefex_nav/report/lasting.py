"""Blocks of `navigation.states` that are missing: of errors that last in a flight, noise to the filter.

Where weight lasts (`scenario.weight`) these errors are biases, and the filter's covariance does not hold
(docs/theory/filter.md, docs/verification/navigation.md). Not looked at: what falls through the air without a
parachute, and that one which opens at a great height hangs in free fall first.
"""

from shefex_nav.instruments import state_sizes
from shefex_nav.onboard.navigation.blocks import OPTIONAL
from shefex_nav.scenario import weight
from shefex_nav.scenario.block import AUTOMATIC


def words(scenario, flown):
    """What `navigation.states` lacks for the flight of a programme.Flown, in one line; "" if nothing.

    scenario : with the states by name, `prepare.settled`
    """
    navigation = scenario.navigation
    if navigation.states == AUTOMATIC:
        raise ValueError("navigation.states: automatic is not settled yet: prepare.settled")
    lasts_s, where = weight.longest(scenario, flown.events, flown.end_s)
    missing = [
        name for name, sigma in weight.errors(scenario.imu).items() if sigma and name not in navigation.states
    ]
    if not weight.is_bias(scenario, lasts_s) or not missing:
        return ""
    whole = [name for name in OPTIONAL | state_sizes() if name in missing or name in navigation.states]
    are, errors_are, them = (
        ("are", "these errors are biases", "them") if missing[1:] else ("is", "this error is a bias", "it")
    )
    return (
        f"{_listed(missing)} {are} missing: {where} for {lasts_s:.0f} s, in which {errors_are} of the IMU; "
        f"the filter takes {them} for noise with a memory of {navigation.thrust_memory:g} s, so that its "
        f"sigmas are wrong; write states: [{', '.join(whole)}]"
    )


def _listed(names):
    """a, b and c."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)
