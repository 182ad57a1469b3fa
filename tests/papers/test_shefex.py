"""The SHEFEX experiments: what they simulate, and what they conclude from results known in advance."""

import numpy as np
import pytest
from scipy import stats

from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker.attitude import covariance
from shefex_nav.papers.shefex2 import attitude, stars
from shefex_nav.papers.shefex2 import field as fields
from shefex_nav.papers.verdict import DIFFERS, Verdict


def row(rows, quantity, condition=""):
    """The one row that has these words."""
    (found,) = [one for one in rows if quantity in one.quantity and condition in one.condition]
    return found


def test_a_field_is_the_catalogue_seen_through_the_camera():
    rng = np.random.default_rng(1)
    for _ in range(20):
        field = fields.draw_field(rng, n_false=3)
        true = field.star >= 0
        assert (~true).sum() == 3
        seen_i = fields.directions(field, 0.0) @ dcm_from_quat(field.q_ic).T
        np.testing.assert_allclose(seen_i[true], fields.flown().u_i[field.star[true]], atol=1e-12)
        centre = dcm_from_quat(field.q_ic)[:, 2]
        cosine = fields.flown().u_i @ centre
        inner = np.degrees(np.arccos(cosine)) < 0.5 * 11.1  # a circle within the detector
        assert set(np.flatnonzero(inner)) <= set(field.star[true])
        vmag = fields.flown().vmag[field.star[true]]
        assert (np.diff(vmag) >= 0.0).all()


def test_field_sizes_are_those_of_the_paper():
    corners = np.array([[-0.5, -0.5], [658.5, 492.5], [658.5, 246.0], [-0.5, 246.0]])
    u_c = fields.unit_vectors(fields.CAMERA, corners)
    assert np.degrees(np.arccos(u_c[2] @ u_c[3])) == pytest.approx(14.87, abs=0.01)
    assert np.degrees(np.arccos(u_c[0] @ u_c[1])) == pytest.approx(np.degrees(fields.FIELD), abs=0.07)


def test_pyramid_names_perfect_stars_and_none_without_tolerance():
    rng = np.random.default_rng(2)
    named = 0
    for _ in range(20):
        field = fields.draw_field(rng)
        u_c = fields.directions(field, 0.0)
        found = fields.match(fields.flown_pairs(), u_c, 1e-7)
        assert (found[found >= 0] == field.star[found >= 0]).all()
        named += (found >= 0).any()
        assert (fields.match(fields.flown_pairs(), fields.directions(field, 1.0), 1e-9) < 0).all()
    assert named >= 18


def test_catalogue_rows():
    results = [stars.measure_catalogue(40, np.random.SeedSequence(1)) for _ in range(2)]
    rows = stars.conclude_catalogue(results)
    assert row(rows, "stars", "size is given").measured == 2023
    filled = row(rows, "pairs", "V <= 5.75")
    assert filled.verdict == Verdict.EXPLAINED and filled.run == "shefex-catalogue/pool to V 5.5"
    (written,) = [row for row in rows if "as the text says" in row.condition and row.published]
    # some depth has any number of pairs, and the paper prints the cut-offs: the scan explains nothing
    assert written.verdict == Verdict.OPEN and not written.run
    assert "the asymmetric catalogue has" in written.why
    deeper = [row(rows, "pairs", f"V <= {5.2 + more:.1f} north") for more in stars.DEEPER]
    assert all(one.verdict == Verdict.NONE for one in deeper)
    pairs = [written.measured, *(one.measured for one in deeper)]
    assert pairs == sorted(pairs, reverse=True) and pairs[-1] < written.published < pairs[0]
    for more, one in zip(stars.DEEPER, deeper, strict=True):
        assert f"{one.measured:.0f} by {more:g}" in written.why
    assert filled.measured < written.published < written.measured
    assert row(rows, "stars", "size is given").verdict == Verdict.INPUT
    few = row(rows, "fewer than four", "uniform")
    assert few.measured == pytest.approx((results[0]["uniform"] < 4).mean())  # both chunks are the same
    assert few.ci95[0] <= few.measured <= few.ci95[1]
    assert all(one.why for one in rows if one.verdict in DIFFERS)


def cos_error_results(time_of, success_of, n=60):
    """As measure_cos_error: (verdict, seconds) from functions of log10 cosError and centroid error."""
    rng = np.random.default_rng(3)
    x = np.log10(stars.COS_ERRORS)
    e = stars.CENTROID_ERRORS_PX[:, None]
    seconds = np.broadcast_to(time_of(x, e), (n, 5, len(x))) * rng.uniform(0.9, 1.1, (n, 1, 1))
    share = np.broadcast_to(success_of(x, e), (5, len(x)))
    rank = (np.arange(n)[:, None, None] + 0.5) / n
    return [(np.where(rank < share, stars.RIGHT, stars.FAILED), seconds)]


def test_curves_like_the_papers_agree():
    results = cos_error_results(
        lambda x, e: 1e-3 * (1.0 + (x + 5.0 - 1.5 * (e - 0.2)) ** 2),
        lambda x, e: 1.0 / (1.0 + np.exp(-6.0 * (x + 5.2 - np.log10(e / 0.1)))),
    )
    rows = stars.conclude_cos_error(results)
    assert [one.verdict for one in rows if one.published is not None] == [Verdict.REPRODUCED] * 4
    assert row(rows, "success", "error 0.1 px").measured > row(rows, "success", "error 0.5 px").measured


def test_curves_unlike_the_papers_do_not_agree():
    results = cos_error_results(lambda x, e: 1e-3 * (7.0 + x), lambda x, e: 0.5 + 0.0 * x * e)
    published = [one for one in stars.conclude_cos_error(results) if one.published is not None]
    assert [one.verdict for one in published] == [Verdict.OPEN] * 4
    assert all(one.why for one in published)


def spike_results(rate):
    """As measure_spikes, from the rate of wrong ones: (number of spikes, cosError)."""
    rank = (np.arange(200)[:, None, None] + 0.5) / 200
    return [np.where(rank < rate, stars.WRONG_ONE, stars.RIGHT)]


def test_spikes_that_mislead_are_seen():
    rate = stars.SPIKES[:, None] / 15.0 * np.array([0.05, 0.1, 0.3, 0.6])
    rows = stars.conclude_spikes(spike_results(rate))
    for words in ("curves that rise", "steps of cosError"):
        assert row(rows, words).verdict == Verdict.REPRODUCED
    assert row(rows, "wrong", "0.0002, 15").measured == pytest.approx(0.6)
    rows = stars.conclude_spikes(spike_results(rate[::-1]))
    assert row(rows, "curves that rise").measured == 0
    assert row(rows, "curves that rise").verdict == Verdict.OPEN  # they fall
    rows = stars.conclude_spikes(spike_results(np.full_like(rate, 0.1)))
    assert row(rows, "curves that rise").verdict == Verdict.TOO_FEW  # 200 attitudes, the paper has 1000
    rows = stars.conclude_spikes(5 * spike_results(np.full_like(rate, 0.1)))
    assert row(rows, "curves that rise").verdict == Verdict.OPEN


@pytest.mark.parametrize("slope", [0.12, 0.25, 0.4])
def test_crossing_of_a_line(slope):
    assert attitude.crossing(slope * attitude.ERRORS_PX) == pytest.approx(0.1 / slope, abs=1e-9)


def test_crossing_of_a_curve_that_never_passes_is_not_invented():
    assert np.isnan(attitude.crossing(0.05 * attitude.ERRORS_PX))
    assert np.isnan(attitude.crossing(0.2 + attitude.ERRORS_PX))


def test_percentiles_leave_out_what_is_missing():
    errors = np.column_stack([np.linspace(-1.0, 1.0, 4001), np.full(4001, np.nan)])
    errors[::2, 0] = np.nan
    assert attitude.percentiles(errors)[0] == pytest.approx(0.975, abs=1e-3)
    assert np.isnan(attitude.percentiles(errors)[1])


def test_attitude_errors_are_those_of_the_covariance():
    """Stars known: the errors about the boresight, normalised by theory, are standard normal."""
    seed = np.random.SeedSequence(5)
    errors, used = attitude.measure_attitude(300, seed)
    rng = np.random.default_rng(seed)
    e = 3
    normalised = []
    for k in range(300):
        field = fields.draw_field(rng)
        n = min(len(field.star), fields.MAX_CENTROIDS)
        assert used[k, 1, e] == n
        if n >= fields.MIN_STARS:
            sigma = np.full(n, attitude.ERRORS_PX[e] / fields.CAMERA.focal_length_px)
            P = covariance(fields.directions(field, 0.0)[:n], sigma)
            normalised.append(np.radians(errors[k, 1, e, 2]) / np.sqrt(P[2, 2]))
    assert stats.kstest(normalised, "norm").pvalue > 1e-3
    assert np.isnan(errors[used < fields.MIN_STARS]).all()


def test_calibration_finds_the_true_camera():
    results = [attitude.measure_calibration(15, np.random.SeedSequence(k)) for k in (1, 2)]
    rows = attitude.conclude_calibration(results)
    assert row(rows, "frames identified").measured >= 0.9
    assert row(rows, "named wrongly").measured == 0
    focal = row(rows, "focal length found [mm]")
    assert row(rows, "focal length of the camera").verdict == Verdict.INPUT
    sigma = (focal.ci95[1] - focal.ci95[0]) / 3.92
    assert abs(focal.measured - attitude.TRUE_MM) < 4.0 * sigma
    assert abs(focal.measured - 25.0) > 4.0 * sigma  # and it is not the nominal one


def test_calibration_without_frames_says_why():
    rows = attitude.conclude_calibration([[None, None]])
    focal = row(rows, "focal length found [mm]")
    assert np.isnan(focal.measured) and focal.verdict == Verdict.TOO_FEW and "no frames" in focal.why
