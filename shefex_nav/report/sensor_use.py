"""What came of the measurements of GPS and star tracker: delivered, used, refused; what is not known of it.

The filter of the program says the fate of every measurement. Software of a user's own may give gate results
or none; without them its flag `star_aided` is all that is known.
"""

import numpy as np

from shefex_nav.onboard.navigation.quantity import ATTITUDE, about, fix_of
from shefex_nav.records import Reason

OWN = ("navigation", "computer")  # sections of the scenario whose software navigates
STARS, GPS = "star_tracker", "gps"
PASSED_OVER = "not judged"  # too old, repeated, or no gate result says it
NO_GATES = "the software gives no gate results: whether measurements were refused is not known"
NO_COVARIANCE = "the software gives no covariance: how large it takes its errors for is not known"


def is_own(data):
    """Whether software of a user's own navigated in a RunData."""
    return any(section in OWN for section, *_ in data.mission.software)


def flew(data):
    """Whether what navigated in a RunData was on board; a solution beside a log has no rates."""
    return bool(np.isfinite(data.nav.omega_ib_b).any())


def good_fixes(data):
    """Star fixes that gave an attitude, in the order of the log."""
    return [fix for fix in data.star_fixes if fix.reason == Reason.NONE]


def stars_used(data):
    """Whether a star fix was used, as far as gate results or `star_aided` say; None: nothing says it."""
    if data.gates:
        return any(about(gate.sensor) is ATTITUDE and gate.accepted for gate in data.gates)
    return bool(np.any(data.nav.star_aided)) if flew(data) else None


def measurements(data):
    """{sensor: delivered, used, refused} of GPS and star tracker; None of what is not known.

    A sensor is one of the gate results (gps_position, gps_velocity ...), or gps and star_tracker where there
    are none of it. RunData -> dict
    """
    given = {STARS: len(good_fixes(data)), GPS: sum(bool(fix.valid) for fix in data.gps)}
    found = {}
    for gate in data.gates:
        if gate.dof and about(gate.sensor) is not None:
            counts = found.setdefault(gate.sensor, {"delivered": None, "used": 0, "refused": 0})
            counts["used" if gate.accepted else "refused"] += 1
    for sensor, n in given.items():
        measured = [name for name in found if (about(name) is ATTITUDE) == (sensor is STARS)]
        for name in measured:
            found[name]["delivered"] = n if n and fix_of(name) else None  # a row of one is no fix
        if n and not measured:
            found[sensor] = {"delivered": n, "used": 0 if _unused(data, sensor) else None, "refused": None}
    return dict(sorted(found.items()))


def _unused(data, sensor):
    """Whether nothing of a sensor without gate results was used, as far as the software says."""
    return sensor is STARS and stars_used(data) is False


def unknown(data):
    """What software of a user's own does not say, in words: list."""
    if not is_own(data) or not flew(data):
        return []
    has_covariance = np.isfinite(data.covariance.P).any() if len(data.covariance.t_s) else False
    return [*([] if data.gates else [NO_GATES]), *([] if has_covariance else [NO_COVARIANCE])]


def named(sensor):
    """A sensor, for people."""
    name = "star fixes" if sensor == STARS else sensor.replace("_", " ").replace("gps", "GPS")
    return f"{name} fixes" if name == "GPS" else name


def fate(get, sensor):
    """(used, refused) of the measurements of a sensor, None of what is not known.

    get : function that gives the value at a dotted path of a summary; of GPS, stars and instruments alike
    """
    used, refused = (get(f"navigation.measurements.{sensor}.{key}") for key in ("used", "refused"))
    if used is None and (readings := get(f"navigation.instruments.{sensor}.readings")) is not None:
        used = get(f"navigation.instruments.{sensor}.used")
        refused = None if used is None else readings - used
    return used, refused


def refused_share(get, sensor):
    """Share of the measurements of a sensor that was refused; None where it is not known. As `fate`"""
    used, refused = fate(get, sensor)
    return None if used is None or refused is None or not used + refused else refused / (used + refused)


def rows(found):
    """(name, text, whether it is odd) of `measurements`, for the table."""
    for sensor, one in found.items():
        name = named(sensor)
        delivered, used, refused = (one[key] for key in ("delivered", "used", "refused"))
        said = [] if delivered is None else [f"{delivered} delivered"]
        if used == 0:
            said.append("none used" if refused is not None else "none used (star_aided was never set)")
        else:
            said.append("how many of them were used is not known" if used is None else f"{used} used")
        said += [f"{refused} refused"] if refused else []
        left = 0 if None in (delivered, used, refused) else delivered - used - refused
        said += [f"{left} {PASSED_OVER}"] if left > 0 else []
        yield name, ", ".join(said), used == 0 or bool(used and refused and refused > used)
