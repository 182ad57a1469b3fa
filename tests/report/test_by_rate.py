"""Success and errors of star fixes by the true rate."""

import math

import numpy as np
import pytest
from made_up import MISSION, frame_truth, of_records, star_fix

from shefex_nav import records as rec
from shefex_nav.report import metrics, star_metrics
from shefex_nav.report.configured import NOTHING


def summarised(frames, fixes):
    return metrics.summarise(of_records(MISSION, [*frames, *fixes]))["star_tracker"]


def test_success_against_rate():
    """Frames within the exclusion angles count nowhere; a limit belongs to the faster interval."""
    rates = (0.0, 0.99, 2.0, 2.5, 9.9, 20.0, 2.5)
    frames = [
        frame_truth(k, 240.0 + 0.1 * k, rate=math.radians(rate + 1e-9), exclusion_met=k != 6)
        for k, rate in enumerate(rates)
    ]
    sigma = 1e-4
    errors = {0: (sigma, 0.0, 0.0), 2: (-sigma, 0.0, 0.0), 3: (0.02, 0.0, 0.0), 6: (0.5, 0.0, 0.0)}
    fixes = [star_fix(k, 240.0 + 0.1 * k, error) for k, error in errors.items()]
    fixes.append(star_fix(4, 240.4, reason=rec.Reason.SMEARED))
    rows = summarised(frames, fixes)["by_rate"]
    assert [
        (row["from_deg_s"], row["to_deg_s"], row["frames"], row["solved"], row["wrong"]) for row in rows
    ] == [
        (0.0, 0.25, 1, 1, 0),
        (0.75, 1.25, 1, 0, 0),
        (2.0, 3.0, 2, 2, 1),
        (8.0, 10.0, 1, 0, 0),
        (15.0, None, 1, 0, 0),
    ]
    slow, _, fast = rows[:3]  # the run's mean error of the two good fixes is zero: n / (n - 1) is two
    assert slow["nees"] == pytest.approx(2.0)
    assert fast["nees"] == pytest.approx(2.0)
    assert fast["cross_axis_rms_arcsec"] == pytest.approx(math.degrees(sigma) * 3600.0 / math.sqrt(2.0))
    assert fast["cross_axis_scatter_arcsec"] == pytest.approx(math.sqrt(2.0) * fast["cross_axis_rms_arcsec"])
    assert rows[3]["nees"] is None
    star = summarised(frames, fixes)
    assert (star["no_fix"], star["no_fix_outside"]) == ({"no_result": 1}, {"no_result": 1, "smeared": 1})


def test_scatter_by_rate_is_without_the_mean_of_the_run():
    """Two fixes at one rate, two at another: scatter 1 or 2 arcsec, of a covariance of 1."""
    arcsec = math.radians(1.0 / 3600.0)
    frames = [frame_truth(k, 240.0 + k, rate=math.radians(0.1 + k // 2)) for k in range(4)]
    errors = [(5.0 + x, 5.0, 3.0 - x) for x in (1.0, -1.0, 2.0, -2.0)]
    fixes = [star_fix(k, 240.0 + k, np.array(e) * arcsec) for k, e in enumerate(errors)]
    fixes = [fix._replace(P_c=np.eye(3) * arcsec**2) for fix in fixes]
    slow, fast = summarised(frames, fixes)["by_rate"]
    for row, size in ((slow, 1.0), (fast, 2.0)):
        whole = size * math.sqrt(4.0 / 3.0)  # four fixes have one mean
        assert row["cross_axis_scatter_arcsec"] == pytest.approx(whole / math.sqrt(2.0), rel=1e-4)
        assert row["boresight_scatter_arcsec"] == pytest.approx(whole, rel=1e-4)
        assert row["cross_axis_rms_arcsec"] == pytest.approx(math.sqrt(25.0 + size**2 / 2.0), rel=1e-4)
        assert row["nees"] == pytest.approx(2.0 * whole**2, rel=1e-4)


@pytest.mark.parametrize("n", [2, 3, 8])
def test_errors_as_large_as_their_covariance_are_so_of_few_fixes_too(n):
    """2000 / n runs of n fixes, seed 1: NEES of 3, normalised error of 1."""
    rng, nees, squares = np.random.default_rng(1), [], []
    frames = [frame_truth(k, 240.0 + 0.1 * k, rate=math.radians(0.1)) for k in range(n)]
    for _ in range(2000 // n):
        fixes = [star_fix(k, 240.0 + 0.1 * k, 1e-4 * rng.standard_normal(3)) for k in range(n)]
        fixes = [fix._replace(P_c=1e-8 * np.eye(3)) for fix in fixes]
        star = star_metrics.summarise(of_records(MISSION, [*frames, *fixes]), NOTHING)
        nees.append(star["by_rate"][0]["nees"])
        squares.append(star["error_arcsec"]["normalised_rms"] ** 2)
    assert np.mean(nees) == pytest.approx(3.0, rel=0.1)  # 3 sigma of 1000 squares of three
    assert np.mean(squares) == pytest.approx(1.0, rel=0.1)


def test_a_single_fix_has_no_scatter():
    star = summarised([frame_truth(0, 240.0)], [star_fix(0, 240.0, (1e-3, 0.0, 0.0))])
    (row,) = star["by_rate"]
    assert row["cross_axis_scatter_arcsec"] is row["boresight_scatter_arcsec"] is row["nees"] is None
    assert star["error_arcsec"]["normalised_rms"] is None and row["cross_axis_rms_arcsec"] > 100.0
