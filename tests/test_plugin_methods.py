"""What ways to find and name stars of a user's own give is looked at before kernels and filter have it."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav import plugin_methods
from shefex_nav.errors import CodeError
from shefex_nav.geometry import pinhole, rotation
from shefex_nav.onboard.startracker.camera import CameraModel
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.papers.settings import STAR_TRACKER
from shefex_nav.records import Detections, Reason

IDENTIFY = STAR_TRACKER.identification
HOLE = pinhole.pinhole(659, 493, 2520.0)


def sky(rng, n=12, others=300):
    """Stars in a picture of a sky: pairs of the catalogue, directions in the camera, light, their rows."""
    u_c = pinhole.unit_vectors(HOLE, rng.uniform([60.0, 60.0], [600.0, 430.0], (n, 2)))
    u_i = u_c @ rotation.dcm_from_quat(rotation.quat_normalise(rng.standard_normal(4))).T
    away = rng.standard_normal((others, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    stars_i = np.concatenate([u_i, away[away @ u_i.mean(axis=0) < 0.9]])
    vmag = np.sort(rng.uniform(1.0, 5.0, len(stars_i)))
    flux = 10.0 ** (-0.4 * vmag[:n])
    pairs = SimpleNamespace(stars=SimpleNamespace(u_i=stars_i, vmag=vmag))
    return pairs, u_c, flux, np.arange(n)


def named(give, settings=IDENTIFY, seed=1):
    """What the tracker gets of a method that gives this. give : function of the true rows"""
    pairs, u_c, flux, rows = sky(np.random.default_rng(seed))
    one = plugin_methods.checked(Method("identification", "mine", lambda *_: give(rows)))
    return one.function(settings, CameraModel(HOLE), pairs, u_c, flux)


def says(star):
    """That these rows are the stars."""
    return Identification(star, int(Reason.NONE), 50.0)


def test_what_the_field_shows_is_handed_on_as_it_is():
    for give in (says, lambda rows: says(np.where(rows < 4, rows, -1))):
        found = named(give)
        assert found.reason == Reason.NONE and found.log_odds == 50.0 and found.star.dtype == np.int64
        np.testing.assert_array_equal(found.star, give(np.arange(12)).star)
    none = named(lambda rows: nothing(len(rows), Reason.NO_MATCH))
    assert none.reason == Reason.NO_MATCH


def test_a_name_that_the_field_does_not_show_is_refused_whatever_the_method_thinks():
    """`acceptance: verified`, which says that every identification is; a method that did not was believed."""

    def shifted(rows):
        return says(np.where(rows < 4, rows[::-1], -1))

    assert named(shifted).reason == Reason.RESIDUALS
    published = replace(IDENTIFY, acceptance="published")
    assert named(shifted, published).reason == Reason.NONE


@pytest.mark.parametrize(
    ("give", "words"),
    [
        (lambda rows: None, "must give an Identification(star, reason, log_odds), got None"),
        (lambda rows: rows, "must give an Identification"),
        (lambda rows: says(rows[:2]), "star must be 12 rows of the catalogue, from 0 to "),
        (lambda rows: says(rows + 0.5), "star must be 12 rows"),
        (lambda rows: says(rows + 99_999_999), "star must be 12 rows"),  # the process crashed
        (lambda rows: says(rows - 5), "star must be 12 rows"),
        (lambda rows: says(None), "star must be 12 rows"),
        (lambda rows: Identification(rows, 99, 0.0), "reason must be one of Reason, got 99"),
    ],
)
def test_names_that_there_cannot_be_are_told(give, words):
    with pytest.raises(CodeError, match="identification 'mine'" + ".*" + re.escape(words)):
        named(give)


XY, P = np.array([[3.0, 4.0], [5.0, 6.0]]), np.tile(0.01 * np.eye(2), (2, 1, 1))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, "must give (xy_px, flux_dn, P_px), got None"),
        ((XY[:1], np.ones(2), P), "xy_px must be numbers, shape (2, 2)"),
        ((XY, np.ones(3), P), "flux_dn must be numbers, shape (2,)"),
        ((XY, np.array([1.0, np.nan]), P), "flux_dn must be numbers"),
        ((XY, np.ones(2), P[0]), "P_px must be numbers, shape (2, 2, 2)"),
    ],
)
def test_places_that_there_cannot_be_are_told(given, words):
    one = plugin_methods.checked(Method("centroid", "mine", lambda *_: given))
    with pytest.raises(CodeError, match="centroid 'mine'" + ".*" + re.escape(words)):
        one.function(None, None, None, np.zeros((2, 9)))


def test_places_are_handed_on_as_they_are():
    one = plugin_methods.checked(Method("centroid", "mine", lambda *_: (XY, np.ones(2, int), P)))
    xy_px, flux_dn, P_px = one.function(None, None, None, np.zeros((2, 9)))
    assert xy_px is XY and P_px is P and flux_dn.dtype == np.float64


def test_a_search_gives_what_it_has_found():
    one = plugin_methods.checked(Method("search", "mine", lambda *_: [Detections(XY, np.ones(2), 0, 0, P)]))
    with pytest.raises(CodeError, match="search 'mine' must give Found, one after the other, got Detections"):
        list(one.function(None))


@pytest.mark.parametrize("step", ["scan", "search"])
def test_a_method_that_fails_is_told_with_its_name(step):
    def found(*_):
        raise ValueError("no star")
        yield 1

    one = plugin_methods.checked(Method(step, "mine", found if step == "search" else divmod))
    with pytest.raises(CodeError, match=rf"^{step} 'mine'.*: (ValueError: no star|TypeError: unsupported)"):
        for _ in one.function("a", "b"):
            pass


def test_what_a_plug_in_prints_is_no_result(capsys):
    one = plugin_methods.checked(Method("scan", "mine", print))
    one.function("said")
    assert capsys.readouterr() == ("", "said\n")
