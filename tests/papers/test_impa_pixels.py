"""IMPA's centroids with pixels that weigh the same, and the run that the package keeps."""

import importlib
import re
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from shefex_nav.papers.impa import centroid_tables, field, flight, kept, moments, pixels, trackers
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.published import IMPA_KURTOSIS
from shefex_nav.papers.verdict import Verdict

TABLE, AXIS, RATE = "global_shutter", "horizontal", 1
GOAL = IMPA_KURTOSIS[TABLE][AXIS][0]
READING = "pixels all alike, spot of 0.6 px, recognised"


def picture():
    """A bright pixel with two fainter ones beside it, a square of four alike, and background."""
    image_dn = np.full((64, 64), 1000, dtype=np.uint16)
    image_dn[20, 30:33] += np.array([900, 100, 100], dtype=np.uint16)
    image_dn[40:42, 10:12] += np.uint16(200)
    return image_dn


def test_pixels_that_weigh_the_same_have_their_middle_as_the_centroid():
    found = cluster.find(trackers.DETECT, trackers.MODEL, picture())
    alike = cluster.weighted(cluster.ALIKE, found)
    assert len(found.energy_dn) == 2
    np.testing.assert_allclose(alike.xy_px, [[31.0, 20.0], [10.5, 40.5]])
    np.testing.assert_allclose(found.xy_px, [[30.0 + 300.0 / 1100.0, 20.0], [10.5, 40.5]], atol=0.03)
    for name in ("energy_dn", "pixels", "begin", "first_column", "last_row"):
        np.testing.assert_array_equal(getattr(alike, name), getattr(found, name))
    assert cluster.weighted(cluster.AS_PRINTED, found) is found


def test_weights_that_are_none_are_refused():
    found = cluster.find(trackers.DETECT, trackers.MODEL, picture())
    with pytest.raises(ValueError, match="pixels all alike"):
        cluster.weighted("squared", found)
    empty = cluster.find(trackers.DETECT, trackers.MODEL, np.full((64, 64), 1000, dtype=np.uint16))
    assert cluster.weighted(cluster.ALIKE, empty).xy_px.shape == (0, 2)


def test_every_spot_and_weight_has_its_recognised_stars():
    case = field.Case(np.radians(1.0), 12, 24)
    for shutter, tables in zip(field.SHUTTERS, ((0.0,), (1.0, 2.0)), strict=True):
        rows = pixels.rows_of(shutter, case, np.random.SeedSequence(4))
        assert set(rows[:, 0]) == set(tables)
        for spot in range(len(pixels.SPOTS)):
            for weight in range(len(cluster.WEIGHTS)):
                of = [rows[(rows[:, :3] == (table, spot, weight)).all(axis=1)] for table in tables]
                assert len(of[0]) >= trackers.IDENTIFY.fewest_stars and len({len(one) for one in of}) == 1
                assert np.abs(of[0][:, 4:]).max() < 2.0  # compensated, or nothing to compensate
        if len(tables) == 2:
            assert np.abs(rows[rows[:, 0] == 2.0, 4:]).max() > 1.5  # px: the rows' time at 1 deg/s


# --- the kept run ---


@pytest.fixture
def keeping(monkeypatch):
    """The module that writes the kept table."""
    monkeypatch.syspath_prepend(Path(__file__).parents[2] / "benchmarks")
    return importlib.import_module("keep_impa_pixels")


def test_the_kept_run_has_every_figure_and_says_what_made_it():
    assert tuple(pixels.SPOTS) == tuple(kept.SPOTS)
    wanted = {
        (reading, table, moment, axis, rate)
        for reading in kept.READINGS
        for table in moments.TABLES
        for moment in moments.MOMENTS
        for axis in moments.AXES
        for rate in moments.RATES
    }
    assert set(kept.figures()) == wanted
    head = kept.PATH.read_text().splitlines()[0]
    assert re.fullmatch(
        r"# shefex-nav reproduce impa-pixels --samples \d+ --seed 1 \(shefex_nav [\d.]+, code [0-9a-f]{16}\)",
        head,
    )
    for one in kept.figures().values():
        assert one.low <= one.value <= one.high and 20 <= one.samples <= one.errors


def test_a_kept_table_reads_back(keeping, tmp_path):
    rng = np.random.default_rng(1)
    made = moments.figures_of(READING, TABLE, RATE, AXIS, rng.standard_normal(4000), np.arange(4000) % 500)
    keeping.write(tmp_path / "table.csv", "a command", made)
    again = kept.read(tmp_path / "table.csv")
    assert list(again) == [one[:5] for one in made]
    for one, other in zip(made, again.values(), strict=True):
        np.testing.assert_allclose(one[5:], other[5:], rtol=1e-3, atol=1e-3)
        assert isinstance(other.samples, int) and isinstance(other.rate, int)


@pytest.mark.parametrize(
    ("shutter", "rate", "tables"), [("global_shutter", 1, (0,)), ("rolling_shutter", 2, (1, 2))]
)
def test_the_spread_of_the_kept_run_comes_again_with_other_noise(shutter, rate, tables):
    """26 of its samples, each shutter at one rate: standard deviations within a fifth, of all readings."""
    rows = [
        pixels.rows_of(shutter, field.pair(np.radians(rate), k), np.random.SeedSequence(900 + k))
        for k in range(26)
    ]
    rows = np.concatenate(rows)
    for reading, (spot, weight, of) in kept.READINGS.items():
        mine = rows[
            (rows[:, 1] == list(kept.SPOTS).index(spot)) & (rows[:, 2] == cluster.WEIGHTS.index(weight))
        ]
        mine = mine if of == "recognised" else mine[mine[:, 3] == 1.0]
        for table in tables:
            errors = mine[mine[:, 0] == table][:, 4:]
            for axis, values in zip(moments.AXES, errors.T, strict=True):
                there = kept.figures()[reading, moments.TABLES[table], "std", axis, rate]
                assert values.std() == pytest.approx(there.value, rel=0.2), (reading, table, axis)


def test_readings_reach_as_many_published_figures_as_the_docs_say(keeping):
    of = [list(keeping.reached(table, kept.figures()).values()) for table in moments.TABLES]
    assert [(max(counts), np.median(counts)) for counts in of] == [(20, 12), (31, 20.5), (22, 19)]


def test_a_reading_says_how_many_things_are_otherwise():
    for reading, words in centroid_tables.WORDS.items():
        n_things = int(words.split()[0])
        if reading in kept.READINGS:
            spot, weight, of = kept.READINGS[reading]
            is_campaigns = spot == f"spot of {field.PSF_SIGMA_PX:g} px"
            n_of_spot = 2 if "both ends" in spot else int(not is_campaigns)
            assert n_things == 1 + n_of_spot + (weight == cluster.ALIKE)
            assert kept.CLUSTERS[of] in words and (spot in words) != is_campaigns
            assert (weight in words) == (weight == cluster.ALIKE)
        else:
            assert n_things == (1 if reading == "stars apart" else 2)


def conclude(kurtosis_of_kept, quantity="kurtosis, horizontal", n=6000):
    """Row of a quantity where the errors here have long tails, the kept run the given Figure or none."""
    rng = np.random.default_rng(2)
    wide = np.where(rng.random((n, 2)) < 0.05, 4.0, 1.0)
    rows = np.full((n, len(centroid_tables.COLUMNS)), np.nan)
    rows[:, :3] = RATE, centroid_tables.KINDS.index(TABLE), 1.0
    rows[:, 3:5] = 0.08 * wide * rng.standard_normal((n, 2))
    for name, value in (("apart", 1.0), ("recognised", 1.0), ("sample", np.arange(n) % 400)):
        rows[:, centroid_tables.COLUMNS.index(name)] = value

    def others(table, moment, axis, _rate):
        if kurtosis_of_kept is None or (table, moment, axis) != (TABLE, "kurtosis", AXIS):
            return {}
        return {READING: moments.judged(kurtosis_of_kept, "")}

    found = centroid_tables.conclude([{"rows": rows}], others)
    return next(one for one in found if one.quantity == quantity)


def figure(value, half, samples=500):
    """Kept kurtosis with its interval."""
    return moments.Figure(
        READING, TABLE, "kurtosis", AXIS, RATE, value, value - half, value + half, samples, 9
    )


def test_a_kept_figure_explains_what_it_reaches():
    found = conclude(figure(GOAL + 0.3, 0.5))
    assert found.verdict == Verdict.EXPLAINED and found.run == f"impa-pixels/{READING}"
    assert f"it is {GOAL + 0.3:.4g}" in found.why
    assert found.why.startswith("3 things otherwise: pixels all alike, spot of 0.6 px, of clusters")


def test_how_far_the_readings_come_is_said_beside_the_rows():
    """The plain clusters, all apart, have 2 of the 8 figures; the kept reading has the one that they lack."""
    quantity = "published figures that the chosen reading reproduces"
    for kept_one, used, n_reached in (
        (figure(GOAL + 0.3, 0.5), READING, 1),
        (figure(GOAL + 3.0, 0.5), "stars apart", 2),  # none explains anything: the first
    ):
        one = conclude(kept_one, quantity)
        assert one.verdict == Verdict.NONE and one.published is None
        assert f"of 8: {used}, chosen afterwards of 23 readings" in one.condition
        assert one.condition.endswith("the best has 2, the median 0") and one.measured == n_reached


@pytest.mark.parametrize(
    "one", [figure(GOAL + 3.0, 0.5), figure(GOAL - 3.0, 0.5), figure(GOAL, 3.0), figure(GOAL, 0.5, 12), None]
)
def test_a_kept_figure_beyond_its_tolerance_or_known_too_loosely_explains_nothing(one):
    found = conclude(one)
    assert found.verdict == Verdict.OPEN and not found.run
    if one is not None:
        assert f"{READING} {one.value:.3g}" in found.why


def test_frames_of_the_spots_differ():
    case = field.Case(np.radians(2.0), 12, 24)
    frames = [flight.frame(TABLE, case, 0, np.random.default_rng(5), **how) for how in pixels.SPOTS.values()]
    assert all((one != other).any() for one, other in pairwise(frames))
