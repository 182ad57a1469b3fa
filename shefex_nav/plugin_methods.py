"""What is wrong with what ways to find and name stars of a plug-in give (`startracker.methods.Method`).

What they name is held against the whole field, unless `acceptance: published` is set: whether a method calls
`verify` itself is its own affair. The kernels read arrays by rows that a method gives, and would read beyond
their ends.
"""

from functools import partial

import numpy as np

from shefex_nav.errors import CodeError, called, shown


def checked(one):
    """A Method whose function says with CodeError that it has failed, or what is wrong with what it gives."""
    how = {"identification": _identified, "search": _found, "centroid": _placed}.get(one.step, called)
    return one._replace(function=partial(how, f"{one.step} '{one.name}'", one.function))


def _identified(words, function, settings, camera, pairs, u_c, flux, P_px=None):
    """As `identify` of a Method; refused where `verify` refuses it."""
    from shefex_nav.onboard.startracker.identify.verify import Identification, verify
    from shefex_nav.records import Reason

    found = called(words, function, settings, camera, pairs, u_c, flux, P_px)
    if not isinstance(found, Identification):
        raise CodeError(f"{words} must give an Identification(star, reason, log_odds), got {shown(found)}")
    star, n = _numbers(found.star), len(pairs.stars.vmag)
    if star.shape != (len(flux),) or star.dtype.kind not in "iu" or not ((star >= -1) & (star < n)).all():
        rows = f"{len(flux)} rows of the catalogue, from 0 to {n - 1}, or -1"
        raise CodeError(f"{words}: star must be {rows}, got {shown(found.star)}")
    if found.reason not in set(Reason):
        raise CodeError(f"{words}: reason must be one of Reason, got {shown(found.reason)}")
    found = found._replace(star=star.astype(np.int64))
    if found.reason != Reason.NONE or settings.acceptance == "published":
        return found
    judged = verify(settings, camera, pairs.stars, u_c, flux, found.star)
    return found if judged.reason == Reason.NONE else judged


def _found(words, function, *given):
    """As `search` of a Method: what it gives one after the other, each made when it is asked for."""
    from shefex_nav.onboard.startracker.objects import Found

    found = iter(called(words, function, *given))
    while (one := called(words, next, found, None)) is not None:
        if not isinstance(one, Found):
            raise CodeError(f"{words} must give Found, one after the other, got {shown(one)}")
        seen = one.detections
        _check_places(words, seen.xy_px, seen.flux_dn, seen.P_px, len(seen.n_pixels))
        yield one


def _placed(words, function, settings, camera, image_dn, table):
    """As `centroid` of a Method."""
    placed = called(words, function, settings, camera, image_dn, table)
    if not isinstance(placed, tuple | list) or len(placed) != 3:
        raise CodeError(f"{words} must give (xy_px, flux_dn, P_px), got {shown(placed)}")
    _check_places(words, *placed, len(table))
    return tuple(np.asarray(column, dtype=np.float64) for column in placed)


def _check_places(words, xy_px, flux_dn, P_px, n):
    """CodeError unless these are places, light and covariances of n objects."""
    columns = {"xy_px": (xy_px, (n, 2)), "flux_dn": (flux_dn, (n,)), "P_px": (P_px, (n, 2, 2))}
    for name, (column, shape) in columns.items():
        array = _numbers(column)
        if array.shape != shape or array.dtype.kind not in "fiu" or not np.isfinite(array).all():
            raise CodeError(f"{words}: {name} must be numbers, shape {shape}, got {shown(column)}")


def _numbers(value):
    """Array of a value; of a ragged one an array of another shape."""
    try:
        return np.asarray(value)
    except ValueError:
        return np.empty((0, 0))
