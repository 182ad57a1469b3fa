"""Success against the rate with the SHEFEX camera: exposure under control, verdicts and their rows."""

import numpy as np
import pytest

from shefex_nav.papers.shefex2 import rates
from shefex_nav.papers.shefex2.frames import SPACE
from shefex_nav.papers.verdict import is_open


def test_the_exposure_scales_light_and_background_alike():
    short = rates.camera_at(0.035)
    assert short.zero_magnitude_electrons == pytest.approx(0.7 * SPACE.zero_magnitude_electrons)
    assert short.background_electrons == pytest.approx(0.7 * SPACE.background_electrons)
    assert short.times.exposure_s == 0.035 and short.times.line_s == 0.0
    assert rates.camera_at(0.05)._replace(times=None) == SPACE


def test_frames_of_a_turning_camera_are_solved_and_the_exposure_stays_in_its_range():
    results = rates.measure(1, np.random.SeedSequence(3))
    assert results["verdicts"].shape == (1, 2, len(rates.RATES))
    assert results["verdicts"][0, 1].sum() >= 5  # ours, at six rates
    exposures = results["exposures"]
    assert exposures.min() >= 0.035 - 1e-9 and exposures.max() <= 0.05 + 1e-9
    rows = rates.conclude([results])
    assert all(row.agrees is not False or row.why for row in rows)


def result(verdict, stars):
    verdicts = np.full((1, 2, len(rates.RATES)), verdict)
    return {"verdicts": verdicts, "exposures": np.full(verdicts.shape, 0.04), "stars": np.array([stars])}


def test_success_is_of_all_frames_and_of_those_with_stars_enough():
    results = [result(1, 9), result(1, 4), result(0, 3), result(-1, 6)]
    rows = rates.conclude(results)

    def measured(words, rate):
        return [r.measured for r in rows if words in r.condition and f"{rate:g} deg/s" in r.condition]

    assert measured("all frames", 5.0) == [0.5, 0.5]
    assert measured("in view", 5.0) == pytest.approx([2 / 3, 2 / 3])
    wrong = [row.measured for row in rows if "wrong" in row.quantity]
    assert wrong == [0.25, 0.25]
    few = {row.quantity: row for row in rows}["ours: success; agrees if at least 90 %"]
    assert few.agrees is None and is_open(few)  # four frames say nothing of 90 %
    rows = rates.conclude(50 * results)
    judged = {row.quantity: row.agrees for row in rows if row.agrees is not None}
    assert judged["as published: success; published: rarely"] is False
    assert judged["ours: success; agrees if at least 90 %"] is False
