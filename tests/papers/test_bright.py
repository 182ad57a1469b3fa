"""The experiments of the brightness-referenced paper: their fields, their judgement, their rows."""

import pickle

import numpy as np
import pytest

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.onboard.startracker.identify.verify import Identification, nothing
from shefex_nav.papers import rows
from shefex_nav.papers.bright import experiments as bright
from shefex_nav.papers.bright import fields as bright_fields
from shefex_nav.papers.bright import frames as bright_frames
from shefex_nav.papers.bright import outcomes as bright_methods
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.verdict import is_open
from shefex_nav.records import Reason
from shefex_nav.report import intervals

SEED = np.random.SeedSequence(5)


@pytest.mark.parametrize(
    "name, samples", [("bright-brightest", 40), ("bright-table3", 15), ("bright-table4", 2)]
)
def test_an_experiment_from_end_to_end(name, samples):
    """Two chunks through another process's eyes, rows for every published figure, and a figure."""
    from matplotlib.figure import Figure

    experiment = pickle.loads(pickle.dumps(bright.EXPERIMENTS[name]))
    results = [pickle.loads(pickle.dumps(experiment.measure(samples, seed))) for seed in SEED.spawn(2)]
    rows = experiment.conclude(results)
    for row in rows:
        assert (row.published is None) == (row.agrees is None and not is_open(row))
        assert bool(row.why) == (row.agrees is False or is_open(row))
        assert row.ci95 is None or row.ci95[0] <= row.measured <= row.ci95[1]
    assert len({(row.quantity, row.condition) for row in rows}) == len(rows)
    experiment.draw(Figure(), results, rows)


def test_table_2_is_exact():
    experiment = bright.EXPERIMENTS["bright-table2"]
    rows = experiment.conclude([experiment.measure(1, SEED)])
    assert [row.measured for row in rows] == [165, 315, 991, 3088, 9381]
    assert all(row.agrees for row in rows)


def test_samples_depend_on_the_seed_alone():
    for measure in (bright.measure_brightest, lambda *a: bright.measure_table3(*a)["square"][0]):
        first, second = (measure(5, np.random.SeedSequence(3)) for _ in range(2))
        np.testing.assert_array_equal(first, second)


@pytest.mark.parametrize("is_round", [False, True])
def test_fields_are_what_the_paper_says(is_round):
    """5 arcsec (3 sigma) an axis, 0.2 mag, one false star, at least three others, all within the field."""
    rng, stars = np.random.default_rng(1), bright_fields.pairs()[0].stars
    offsets, magnitudes = [], []
    for _ in range(150):
        field = bright_fields.draw_field(rng, stars, least=3, n_false=1, is_round=is_round)
        assert (np.diff(field.flux) <= 0.0).all()
        assert (field.star < 0).sum() == 1 and len(field.star) >= 4
        angle = np.degrees(np.arccos(field.u_c[:, 2]))
        assert angle.max() < (10.01 if is_round else 14.3)
        known = field.star >= 0
        magnitudes.extend(-2.5 * np.log10(field.flux[known]) - stars.vmag[field.star[known]])
        cosines = field.u_c[known] @ field.u_c[known].T
        true = stars.u_i[field.star[known]] @ stars.u_i[field.star[known]].T
        pick = np.triu_indices(known.sum(), 1)
        offsets.extend((np.arccos(cosines[pick]) - np.arccos(true[pick])) / bright_fields.ARCSEC)
    assert np.std(magnitudes) == pytest.approx(0.2, rel=0.1)
    # of an angle: sqrt(2) times 5/3 arcsec, and a little more in the middle, where a pixel is an arcsec more
    assert np.std(offsets) == pytest.approx(np.sqrt(2.0) * 5.0 / 3.0, rel=0.1)


def test_judgement():
    star = np.array([4, -1, 7, 9])
    found = Identification(np.array([4, -1, 7, 9]), int(Reason.NONE), np.nan)
    assert bright_methods.judge(found, star) == bright_methods.SUCCESS
    part = found._replace(star=np.array([4, -1, 7, -1]))
    assert bright_methods.judge(part, star) == bright_methods.SUCCESS
    false_named = found._replace(star=np.array([4, 5, 7, 9]))
    assert bright_methods.judge(false_named, star) == bright_methods.WRONG
    assert bright_methods.judge(nothing(4, Reason.NO_MATCH), star) == bright_methods.FAILED


def test_shares_agree_when_their_intervals_meet():
    """Of 10 000 each: 118 and 124 may be the same, 118 and 30 may not; 0 leaves room for 2 and not for 20."""

    def row(published, k):
        return bright_methods.share_row("q", "c", published, k, 10000, 10000, "because")

    assert row(0.0118, 124).agrees and row(0.0118, 124).why == ""
    assert row(0.0118, 30).agrees is False and row(0.0118, 30).why == "because"
    assert row(0.0, 2).agrees and not row(0.0, 20).agrees
    assert rows.share("q", "c", 3, 10) == Row("q", "c", None, 0.3, intervals.proportion(3, 10), None, "")


def test_every_published_method_has_a_reason_ready():
    for situation in [*bright.SITUATIONS, "rendered frames"]:
        for shape in ("square field", "round field"):
            for method in bright_methods.PUBLISHED:
                assert bright_methods.reason(f"{situation}, {shape}", method)


def test_frames_show_the_stars_where_and_as_bright_as_they_are():
    """Centroids 5 arcsec (3 sigma) as in the paper, magnitudes off by 0.25 and never by more than 0.7."""
    rng, stars = np.random.default_rng(2), bright_fields.pairs()[0].stars
    offsets, magnitudes = [], []
    for _ in range(6):
        image_dn, q_ic = bright_frames.draw_frame(rng)
        assert image_dn.dtype == np.uint16 and image_dn.shape == (1024, 1024)
        field = bright_frames.detected_field(image_dn, q_ic)
        rows, xy_px = bright_fields.in_view(stars, q_ic, False)
        assert len(rows) >= 6
        place = dict(zip(rows.tolist(), xy_px, strict=True))
        for k in np.flatnonzero(field.star >= 0):
            row = field.star[k]
            offsets.append(pixels(bright_fields.CAMERA, field.u_c[k : k + 1])[0] - place[row])
            magnitudes.append(-2.5 * np.log10(field.flux[k]) - stars.vmag[row])
    offsets, magnitudes = np.array(offsets), np.array(magnitudes)
    # the median, as faint stars below the catalogue shift some of them
    assert 1.48 * np.median(np.abs(offsets)) < bright_fields.SIGMA_PX
    assert np.std(magnitudes) == pytest.approx(0.25, rel=0.25)
    assert np.percentile(np.abs(magnitudes), 90) < 0.7
