"""Spoilt files are read or refused in words. Many more of them: benchmarks/fuzz.py."""

from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
FOUND = {  # cases that ended in a traceback once
    "logs": (94, 105),  # the description of a topic was damaged
    "fields": (
        1032,
        1308,
        1092,
        1181,
        1195,
        1261,
        1278,
    ),  # a text or a number that is none, lists, no scenario
    "commands": (10,),  # a brace as an argument
}
CASES = {
    "scenarios": 30,
    "logs": 60,
    "fields": 8,
    "pictures": 8,
    "data": 12,
    "kf_gins": 12,
    "matlab": 20,
    "answers": 5,
    "commands": 20,
}


@pytest.fixture
def fuzz(monkeypatch):
    monkeypatch.syspath_prepend(BENCHMARKS)
    import fuzz

    return fuzz


@pytest.mark.filterwarnings("ignore")  # of Pillow and astropy about what is wrong with a picture
@pytest.mark.parametrize("name", CASES)
def test_spoilt_files_are_read_or_refused(name, fuzz, tmp_path):
    numbers = (*FOUND.get(name, ()), *range(CASES[name]))
    count, bad, _ = fuzz.study(name, tmp_path, numbers, float("inf"))
    assert not bad
    assert count["refused"] > 0.2 * len(numbers) and count["read"] > 0


def test_what_is_bad_is_noticed(fuzz, tmp_path, monkeypatch):
    kind = fuzz.Kind(tmp_path)
    monkeypatch.setattr(kind, "case", lambda rng: None)
    monkeypatch.setattr(kind, "read", lambda rng: {}["key"])
    outcome, words, _ = fuzz.tried(kind, 1)
    assert outcome == "traceback" and words.startswith("KeyError: 'key'")
    monkeypatch.setattr(kind, "longest_s", -1.0)
    monkeypatch.setattr(kind, "read", lambda rng: None)
    assert fuzz.tried(kind, 1)[0] == "slow"


def test_a_case_is_the_same_again(fuzz, tmp_path):
    kind = fuzz.Scenarios(tmp_path)
    for number in range(5):
        kind.case(fuzz.np.random.default_rng(number))
        first = (tmp_path / "case.yaml").read_bytes()
        kind.case(fuzz.np.random.default_rng(number))
        assert (tmp_path / "case.yaml").read_bytes() == first
