"""Which slope of `integrity_protection` a measurement has: by how its sensor is gated, not by which it is.

Star fixes alone are known by name, for what they mislead is attitude and mounting together.
"""

from shefex_nav.onboard.navigation import integrity_protection, protected
from shefex_nav.onboard.navigation.grown import Grown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.state import POS, VEL


def slope(nav, now, measurement, P, prior, H, R, confirmed):
    """Slope of a measurement that has just been used.

    nav : Filter;  now : Moment, after it;  measurement : as decided
    P, prior : (n, n) before it, and after a reset forgot, or the same
    H, R : (m, n), (m, m) of the rows used;  confirmed : whether another fix agrees with it
    """
    name, limit = measurement.sensor, nav.limit(len(R))
    rows, axes = nav.sensors[name].rows, nav.watch.level_axes(nav.earth, now.t_s, now.x)
    grown = isinstance(measurement.admitted, Grown)  # no fix has confirmed it
    agreed = confirmed or (measurement.fate == Fate.RESET and not grown)  # `judge`: its rejected fixes agree
    if name == "star_vectors":
        found = integrity_protection.slope_of_vectors(nav.layout, prior, now.P, nav.limit(2), H, R, axes)
    elif name == "star_tracker":
        found = integrity_protection.slope_of_stars(prior, now.P, limit, H, R, confirmed, axes)
    elif rows:
        one = nav.limit(rows)
        found = integrity_protection.slope_of_rows(prior, now.P, one, H, R, rows, axes, agreed)
    else:
        found = integrity_protection.slope(prior, now.P, limit, axes, agreed)
        block = nav.layout.places.get(nav.sensors[name].block)
        if len(R) == 3 and block in (POS, VEL) and prior is P:
            integrity_protection.bound(found, P, H, R, limit, block.start, axes)
    if prior is not P:
        found.table[integrity_protection.BEFORE] = protected.sigmas(P, axes)
    return found
