"""IMPA's centroids with other spots and of recognised stars."""

from math import gcd

import numpy as np
import pytest

from shefex_nav.geometry import pinhole, rotation
from shefex_nav.papers.impa import centroid_tables, centroids, field, flight, moments
from shefex_nav.papers.impa.methods.compensate import Streaks
from shefex_nav.papers.impa.published import IMPA, IMPA_KURTOSIS
from shefex_nav.papers.verdict import Verdict
from shefex_nav.report import intervals
from shefex_nav.world.camera import motion, render

WIDTH = float(IMPA["camera"]["psf_diameter_px"])
LIGHT = 3e5


def light_of(place_px, omega_c):
    """Light of one star of the magnitude 0 or so, without noise: (rows, columns) electrons."""
    psf, times, hole = field.box(WIDTH), field.times("global_shutter"), field.CAMERA
    sheet = render.darkness(hole.width_px * hole.height_px)
    path = motion.turning(hole, np.eye(3), omega_c, times, psf.step_px)
    u_c = pinhole.unit_vectors(hole, np.array([place_px]))
    render.add_points(sheet, hole, psf, path, u_c, np.array([LIGHT]), 1e-3)
    return sheet.electrons.reshape(hole.height_px, hole.width_px).astype(float)


@pytest.mark.parametrize("off_px", [0.0, 0.3, -0.45])
def test_a_box_is_even_over_its_width_wherever_it_lies(off_px):
    """A spot at rest, 3 px wide: each column has as much of the light as it overlaps with it."""
    light = light_of((500.0 + off_px, 400.0), np.zeros(3))
    share = light[397:404, 496:505].sum(axis=0) / LIGHT
    at = np.arange(496, 505)
    low, high = np.maximum(at - 0.5, 498.5 + off_px), np.minimum(at + 0.5, 501.5 + off_px)
    np.testing.assert_allclose(share, np.maximum(high - low, 0.0) / 3.0, atol=0.004)
    assert light.sum() == pytest.approx(LIGHT, rel=0.01)
    assert share @ at == pytest.approx(500.0 + off_px, abs=0.02)


def test_a_streak_of_a_box_covers_as_many_pixels_as_equation_26_says():
    """5 deg/s along the rows: r_psf l / IFOV pixels, all with the same light."""
    omega_c = np.array([0.0, -np.radians(5.0), 0.0])
    light = light_of((511.5, 512.0), omega_c)
    length_px = np.radians(5.0) * field.EXPOSURE_S * field.CAMERA.focal_length_px
    inside = light[511:514, 511 - 20 : 512 + 20]
    expected = LIGHT / (WIDTH * length_px)
    np.testing.assert_allclose(inside, expected, rtol=0.08)
    assert inside.mean() == pytest.approx(expected, rel=0.01)
    assert light[:510].sum() + light[515:].sum() == 0.0


def test_the_recognised_clusters_are_the_catalogue_stars_in_any_order():
    """Stars of one field and false objects between them, one of which no star can make."""
    rng, stars = np.random.default_rng(3), field.pairs(False).stars
    C_ic = rotation.dcm_from_quat(field.attitudes()[11])
    u_c = stars.u_i @ C_ic
    xy_px = pinhole.pixels(field.CAMERA, np.ascontiguousarray(u_c[u_c[:, 2] > 0.9]))
    seen = ((xy_px > 5.0) & (xy_px < 1018.0)).all(axis=1)
    xy_px, vmag = xy_px[seen], stars.vmag[u_c[:, 2] > 0.9][seen]
    n = len(xy_px)
    assert n > 8
    places = np.vstack([xy_px, rng.uniform(20.0, 1000.0, (4, 2)), [[np.nan, np.nan]]])
    energy = 10.0 ** (-0.4 * np.concatenate([vmag, [1.0, 2.0, 3.0, 4.0, 0.5]]))
    energy_dn = energy * centroids.trackers.ZERO_FLUX_DN
    named = []
    for mixed in (np.arange(n + 5), rng.permutation(n + 5)):
        seen_s = np.full(n + 5, field.EXPOSURE_S)
        streaks = Streaks(places[mixed], np.zeros((n + 5, 2)), seen_s, np.zeros((n + 5, 2, 2)))
        found = centroids.recognised(field.times("global_shutter"), energy_dn[mixed], streaks)
        named.append(set(mixed[found]))
    assert named[0] == named[1] and len(named[0]) > 0.6 * n  # those that could be each other are left out
    assert max(named[0]) < n


def test_errors_of_stars_seen_alike_at_all_speeds_have_the_kurtosis_of_table_5():
    """Not compensated, a star is off by its speed times the time of its row: even over the rows."""
    rows = np.linspace(-1.0, 1.0, 2001)
    off = np.outer(rows, field.directions()[:, 0]).ravel()
    kurtosis = (off**4).mean() / (off**2).mean() ** 2
    published = IMPA_KURTOSIS["rolling_uncompensated"]
    assert kurtosis == pytest.approx(published["horizontal"][0], abs=0.02)
    assert kurtosis == pytest.approx(published["vertical"][0], abs=0.06)


def test_ours_meet_every_direction_and_attitude():
    for cycle in (field.N_DIRECTIONS, field.N_ATTITUDES, len(field.RATES)):
        assert gcd(centroids.OWN_EVERY, cycle) == 1


def test_a_case_is_seen_with_three_spots_and_ours_where_they_are_asked_for():
    case = field.Case(np.radians(2.0), 12, 24)
    rows = np.array(centroids.frames_of("rolling_shutter", case, np.random.SeedSequence(4), with_own=False))
    kinds = {centroid_tables.KINDS[int(k)] for k in centroid_tables.column(rows, "kind")}
    rolling = centroid_tables.PUBLISHED[1:]
    assert kinds == {
        *rolling,
        *(centroid_tables.with_spot(k, s) for k in rolling for s in ("box", "joint spot")),
    }
    for kind in kinds:
        mine = rows[centroid_tables.column(rows, "kind") == centroid_tables.KINDS.index(kind)]
        assert len(mine) > 3 and set(centroid_tables.column(mine, "recognised")) <= {0.0, 1.0}
    again = np.array(centroids.frames_of("rolling_shutter", case, np.random.SeedSequence(4)))
    own = centroid_tables.column(again, "kind") == centroid_tables.KINDS.index("ours_rolling")
    assert own.any()
    np.testing.assert_array_equal(again[~own], rows)  # ours change nothing of the others


def test_frames_with_the_default_spot_are_what_they_were():
    case = field.Case(np.radians(2.0), 12, 24)
    one, other = (
        flight.frame("rolling_shutter", case, 0, np.random.default_rng(5), **how)
        for how in ({}, {"psf": None, "sigma_px": field.PSF_SIGMA_PX})
    )
    np.testing.assert_array_equal(one, other)
    boxed = flight.frame("rolling_shutter", case, 0, np.random.default_rng(5), psf=field.box(WIDTH))
    assert (boxed != one).any()


# --- what explains ---


def table(kind, errors, recognised=1.0, n_samples=400):
    """Rows of a kind at 1 deg/s; errors (n, 2), spread over the samples."""
    n = len(errors)
    rows = np.full((n, len(centroid_tables.COLUMNS)), np.nan)
    rows[:, :3] = 1.0, centroid_tables.KINDS.index(kind), 1.0
    rows[:, 3:5] = errors
    for name, value in (("apart", 1.0), ("recognised", recognised), ("sample", np.arange(n) % n_samples)):
        rows[:, centroid_tables.COLUMNS.index(name)] = value
    return rows


def with_kurtosis(rng, n, kurtosis):
    """(n, 2) errors of two Gaussians, a narrow one and one in five times wider, whose mixture has it."""
    share = 0.2
    ratios = np.linspace(1.0, 9.0, 4000)
    of = 3.0 * (1 - share + share * ratios**4) / (1 - share + share * ratios**2) ** 2
    ratio = ratios[np.abs(of - kurtosis).argmin()]
    return rng.standard_normal((n, 2)) * np.where(rng.random((n, 2)) < share, ratio, 1.0) * 0.1


def kurtosis_row(*rows):
    found = centroid_tables.conclude([{"rows": np.concatenate(rows)}], lambda *_figure: {})
    return next(one for one in found if one.quantity == "kurtosis, horizontal")


@pytest.mark.parametrize("spot_name", [centroid_tables.BOX, centroid_tables.JOINT])
def test_another_spot_explains_a_kurtosis_where_its_run_reaches_it(spot_name):
    rng, goal = np.random.default_rng(2), IMPA_KURTOSIS["global_shutter"]["horizontal"][0]
    plain = table("global_shutter", with_kurtosis(rng, 6000, 2.0 * goal))
    other = centroid_tables.with_spot("global_shutter", spot_name)
    reached = kurtosis_row(plain, table(other, with_kurtosis(rng, 20000, goal)))
    assert reached.verdict == Verdict.EXPLAINED
    assert reached.run == f"impa-centroids/recognised and apart, {spot_name}"
    short = kurtosis_row(plain, table(other, rng.standard_normal((6000, 2)) * 0.1))
    assert short.verdict == Verdict.OPEN and f"recognised and apart, {spot_name} 2.84" in short.why


def test_clusters_that_nothing_names_explain_nothing():
    rng, goal = np.random.default_rng(2), IMPA_KURTOSIS["global_shutter"]["horizontal"][0]
    plain = table("global_shutter", with_kurtosis(rng, 6000, 2.0 * goal))
    other = centroid_tables.with_spot("global_shutter", centroid_tables.BOX)
    found = kurtosis_row(plain, table(other, with_kurtosis(rng, 20000, goal), recognised=0.0))
    assert found.verdict == Verdict.OPEN and "box" not in found.why


def test_the_intervals_of_the_moments_are_those_of_the_bootstrap():
    rng = np.random.default_rng(1)
    sums = moments.power_sums(rng.standard_t(6, 1200), rng.integers(0, 80, 1200))
    ends = moments.moment_intervals(sums, np.random.default_rng(2))
    for k in (0, 2, 3):
        one = intervals.bootstrap(lambda d, k=k: moments.moments(d)[k], [sums], rng)
        np.testing.assert_allclose(ends[k], one, atol=0.12 * (one[1] - one[0]))


def test_the_interval_of_a_standard_deviation_holds_it():
    """Long tails, 24 samples of up to seven errors; resampled 86 of 100 intervals do."""
    rng, n, trials, held = np.random.default_rng(3), 24, 1000, 0
    for _ in range(trials):
        sample = np.repeat(np.arange(n), rng.integers(1, 8, n))
        sums = moments.power_sums(rng.standard_t(6, len(sample)), sample)
        low, high = moments.moment_intervals(sums, rng)[1]
        held += low <= np.sqrt(1.5) <= high  # Student's of six degrees of freedom
    assert held > 0.885 * trials


def test_a_kurtosis_has_no_upper_end():
    """Of Student's with 4.5 degrees of freedom it is 15: few intervals of samples hold it, they end below."""
    rng, goal = np.random.default_rng(4), IMPA_KURTOSIS["global_shutter"]["horizontal"][0]
    errors, sample = 0.1 * rng.standard_t(4.5, 6000), np.arange(6000) % 520
    one = moments.figures_of("", "global_shutter", 1, "horizontal", errors, sample)[-1]
    low, high = moments.judged(one, "").ci95
    assert one.moment == "kurtosis" and low < one.high < 15.0 and np.isinf(high)
    for value, expected in ((goal - 0.2, Verdict.REPRODUCED), (goal - 2.0, Verdict.TOO_FEW)):
        made = moments.judged(one._replace(value=value, low=value - 0.5, high=value + 0.5), "")
        assert made.verdict == expected
        assert (made.why == moments.UNBOUNDED) == (expected == Verdict.TOO_FEW)
    above = one._replace(value=goal + 2.0, low=goal + 1.5, high=goal + 2.5)
    assert moments.judged(above, "").verdict == Verdict.OPEN


def test_the_sample_of_the_paper_has_an_error_too():
    """5200 attitudes and directions there: a tenth of them here are told apart a twentieth less well."""
    one = moments.Figure("", "global_shutter", "std", "horizontal", 1, 0.2, 0.19, 0.21, 520, 4000)
    assert moments.judged(one, "").tolerance == pytest.approx(0.01 * np.sqrt(1.1) + 0.0005)
