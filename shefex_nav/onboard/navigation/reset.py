"""What a measurement takes from the covariance before it is used: a reset, and what is doubted with it."""

import numpy as np

from shefex_nav.onboard.navigation import eskf, integrity_learnt
from shefex_nav.onboard.navigation.grown import Grown
from shefex_nav.onboard.navigation.integrity import Fate
from shefex_nav.onboard.navigation.quantity import POSITION, fix_of
from shefex_nav.onboard.navigation.state import initial_covariance


def forgotten(nav, P, measurement, H):
    """Covariance in which nothing is known of what a sensor measures, or less by a sigma that is admitted.

    And less of what is doubted with it. Of a position without height the height stays known: H (2, n) says
    where it lies.
    -> (n, n), slices of the blocks whose ties to others are cut
    """
    if measurement.fate == Fate.USED and not measurement.doubts:
        return P, ()
    sensor, admitted = nav.sensors[measurement.sensor], measurement.admitted
    order, x, P, cut = nav.layout, nav.history.x, P.copy(), ()
    places = order.places
    named = [name for name in (sensor.block, *sensor.with_it) if places[name] is not None]
    if isinstance(admitted, Grown):
        P *= np.outer(admitted.factors, admitted.factors)
    elif admitted is not None:
        added = admitted if isinstance(admitted, dict) else dict.fromkeys(named, np.full(3, admitted))
        integrity_learnt.add(P, order, x, added)
    elif measurement.fate != Fate.USED and len(H) == 2 and fix_of(measurement.sensor) is POSITION:
        level = H[:, places[sensor.block]]
        P[places[sensor.block], places[sensor.block]] += sensor.forgotten**2 * (level.T @ level)
    elif measurement.fate != Fate.USED:
        for name in named:
            known = sensor.forgotten**2 if name == sensor.block else initial_covariance(nav.params, name)
            P = eskf.forget(P, places[name], known)
        cut = tuple(places[name] for name in named)
    integrity_learnt.add(P, order, x, measurement.doubts or {})
    return P, cut
