"""Whether `compare` says of each filter if its covariance describes its errors."""

import json

import numpy as np
import pytest
from scipy import stats

from shefex_nav.campaign import over_time
from shefex_nav.campaign.compare import described, parts, sides

RUNS = 40


def series_of(scale):
    """Series of RUNS runs at rest, then on the descent, whose sigmas are `scale` times too large.

    scale : {(phase, block): factor}, 1 where nothing is said
    """
    rng, T = np.random.default_rng(5), 20
    errors = rng.standard_normal((RUNS, T, 5, 3)).astype(np.float32)
    phase = np.zeros((RUNS, T), np.int8)
    phase[:, T // 2 :] = 5
    sigmas = np.ones_like(errors)
    for (of_phase, block), factor in scale.items():
        sigmas[:, phase[0] == of_phase, over_time.BLOCKS.index(block)] = factor
    nees = np.sum((errors / sigmas) ** 2, axis=3)
    return over_time.Series(np.arange(RUNS), np.arange(T) / 10.0, errors, sigmas, nees, phase, {}, {})


def side(entry_s=None):
    """A Side whose runs enter at a time."""
    runs = {
        k: sides.Flown(k, k, "", {described.ENTRY_S: entry_s}.get, (), {}) for k in range(RUNS)
    }  # fmt: skip
    return sides.Side("A", "mine", None, "campaign", "", {}, {}, runs)


@pytest.fixture
def judged(monkeypatch):
    """Function that gives rows of a Series."""

    def rows(series, entry_s=None):
        monkeypatch.setattr(described, "_kept", lambda side: "kept")
        monkeypatch.setattr(over_time, "read", lambda kept: series)
        return list(described.rows(described.of_side(side(entry_s))))

    return rows


def test_an_honest_filter_has_a_row_for_each_block(judged):
    rows = judged(series_of({}), entry_s=1.5)
    assert [(cells[0], cells[1], is_wrong) for cells, is_wrong in rows] == [
        (block, "entry and all ends of phases", False) for block in ("position", "velocity", "attitude")
    ]
    assert all(cells[-1].startswith(described.CHANCE) for cells, _ in rows)


def test_the_phase_and_the_block_are_named_whose_sigmas_are_wrong(judged):
    """Ten times too large on the way down, where entry is, and a third of the errors at rest."""
    rows = judged(series_of({(5, "attitude"): 10.0, (0, "velocity"): 1.0 / 3.0}), entry_s=1.5)
    found = {cells[:2]: cells[-1] for cells, _ in rows}
    assert found[("position", "entry and all ends of phases")].startswith(described.CHANCE)
    assert found[("velocity", "at all others")].startswith(described.CHANCE)
    for key, kind, times in (
        (("attitude", "entry"), "large", 10.0),
        (("attitude", "end of descent"), "large", 10.0),
        (("velocity", "end of pad"), "small", 3.0),
    ):
        words = found[key].split()
        assert (words[0], words[-1]) == ("sigmas", kind)
        assert float(words[1]) == pytest.approx(times, rel=0.15)
    ratio = {
        cells[:2]: float(cells[4]) for cells, _ in rows if cells[0] == "attitude" and "all" not in cells[1]
    }
    assert ratio[("attitude", "entry")] == pytest.approx(10.0, rel=0.15)


def test_what_is_wrong_alike_everywhere_is_one_row(judged):
    rows = judged(series_of({(0, "position"): 4.0, (5, "position"): 8.0}))
    (words,) = [cells for cells, _ in rows if cells[0] == "position"]
    assert words[1] == "all ends of phases" and "times too large, most at end of descent" in words[-1]
    low, _, high = words[-1].split()[1:4]
    assert (float(low), float(high)) == pytest.approx((4.0, 8.0), rel=0.15)


def test_a_verdict_explains_a_value_outside_of_what_is_expected_beside_it():
    """p of 1 % is outside of 95 %: chance explains it among fifteen, and does not among two."""

    def found(*p):
        """Described of position at entry, then of ends of phases, by the p of each."""
        values = [stats.chi2.isf(0.5 * one, 3 * RUNS) for one in p]
        alone = [over_time.chi_square("", value, 3 * RUNS, RUNS) for value in values]
        return [
            described.Described("position", described.ENTRY if k == 0 else f"end of {k}", k, verdict, 1.0)
            for k, verdict in enumerate(over_time.with_holm(alone))
        ]

    ((cells, is_wrong),) = described.rows(found(0.01, *[0.9] * 14))
    assert not is_wrong
    assert cells[-1] == "as chance would have it: 1 of 15 outside if judged alone, not among all 15"
    low, high = (float(end) for end in cells[3].split(" to "))
    assert low < 1.0 < high < float(cells[2].split(" to ")[1])
    ((cells, is_wrong),) = described.rows(found(0.06, *[0.9] * 14))
    assert not is_wrong and cells[-1] == "as chance would have it"
    (cells, is_wrong), (others, _) = described.rows(found(0.01, 0.9))
    assert is_wrong and "too small" in cells[-1] and others[-1] == "as chance would have it"
    (_, (others, is_wrong)) = described.rows(found(1e-9, 0.03, *[0.9] * 3)[:2])
    assert not is_wrong and others[-1] == "as chance would have it: outside if judged alone, not among all 2"


def test_compare_says_it_of_logs_and_names_the_reports(tmp_path, command):
    log = tmp_path / "a.mcap"
    ends = ["--set", "mission.time_limit=3 s", "--set", "star_tracker.off=3 s"]
    assert command("run", "scenarios/night_sky.yaml", "--out", str(log), *ends).code == 0
    told = command("compare", str(log), str(log), "--json")
    assert told.code == 0, told.err
    found = json.loads(told.out)
    assert set(found["covariances"]) == {"A", "B"} and len(found["covariances"]["A"]) >= 3
    assert all(one["runs"] == 1 and one["sigma_over_error"] > 0.0 for one in found["covariances"]["A"])
    assert found["reports"] == [f"shefex-nav report {log}"]
    text = command("compare", str(log), str(log)).out
    assert "Does the covariance of each describe its errors?" in text
    assert f"shefex-nav report {log}" in text.replace("\n", "")


def test_a_side_without_a_covariance_is_said_to_have_none(monkeypatch):
    monkeypatch.setattr(described, "of_side", lambda side: [])
    part = parts._honest([side()])
    assert part.lines == ("A gives no covariance: there is nothing to judge.",) and not part.rows
