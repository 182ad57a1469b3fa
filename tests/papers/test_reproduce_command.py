"""`shefex-nav reproduce` as users meet it, with an experiment of the tests in the register."""

import json

import pytest
import toy
from typer.testing import CliRunner

from shefex_nav.commands.main import app
from shefex_nav.papers import registry
from shefex_nav.papers.verdict import TOO_FEW

RUNNER = CliRunner()


@pytest.fixture
def toy_registered(monkeypatch):
    monkeypatch.setattr(registry, "EXPERIMENTS", {"toy": ("toy", "a standard normal")})
    monkeypatch.setattr(registry, "load", lambda name: toy.NORMAL)


def reproduce(*arguments):
    return RUNNER.invoke(app, ["reproduce", *(str(one) for one in arguments)])


def test_the_experiments_are_listed_without_a_name_and_in_the_help():
    for result in (reproduce(), reproduce("--help")):
        assert result.exit_code == 0
        for name, (_, about) in registry.EXPERIMENTS.items():
            assert name in result.stdout and about in result.stdout


def test_table_and_figure(toy_registered, tmp_path):
    out = tmp_path / "figures" / "deep"
    result = reproduce("toy", "--samples", 200, "--out", out)
    assert result.exit_code == 0, result.output
    assert "a standard normal" in result.stdout and "NO [1]" in result.stdout
    assert "[1] there is nothing to measure it with" in result.stdout
    assert "200 numbers, seed 1" in result.stdout
    assert (out / "toy.png").read_bytes().startswith(b"\x89PNG")


def test_json_is_one_strict_object(toy_registered, tmp_path):
    result = reproduce("toy", "--samples", 200, "--seed", 7, "--out", tmp_path, "--json")
    assert result.exit_code == 0, result.output

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    found = json.loads(result.stdout, parse_constant=refuse)
    assert list(found) == ["experiment", "seed", "samples", "rows", "wall_s"]
    assert (found["experiment"], found["seed"], found["samples"]) == ("toy", 7, 200)
    mean, impossible = found["rows"]
    assert list(mean) == ["quantity", "condition", "published", "measured", "ci95", "agrees", "why"]
    assert mean["ci95"][0] < mean["measured"] < mean["ci95"][1] and mean["agrees"] is True
    assert impossible["measured"] is None and impossible["ci95"] is None and impossible["agrees"] is False


def test_a_sample_that_cannot_tell_says_so(toy_registered, tmp_path, monkeypatch):
    def undecided(results):
        return [toy.conclude(results)[0]._replace(agrees=None, why=TOO_FEW)]

    monkeypatch.setattr(registry, "load", lambda name: toy.NORMAL._replace(conclude=undecided))
    arguments = ("toy", "--samples", 2, "--out", tmp_path)
    shown = reproduce(*arguments).stdout
    assert "too few [1]" in shown and "NO" not in shown and "[1] too few samples" in shown
    (row,) = json.loads(reproduce(*arguments, "--json").stdout)["rows"]
    assert row["agrees"] is None and row["why"] == TOO_FEW


def test_all_is_an_object_of_experiments(toy_registered, tmp_path):
    result = reproduce("all", "--samples", 50, "--out", tmp_path, "--json")
    assert [one["experiment"] for one in json.loads(result.stdout)["experiments"]] == ["toy"]


def test_the_default_sample_is_the_papers(toy_registered, tmp_path):
    result = reproduce("toy", "--out", tmp_path, "--json")
    assert json.loads(result.stdout)["samples"] == toy.NORMAL.samples


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("shefex-spike",), "shefex-spikes"),
        (("toy", "--samples", 0), "--samples"),
        (("toy", "--samples", -3), "at least 1"),
        (("toy", "--out", "FILE/figures"), "--out"),
    ],
)
def test_bad_input_is_one_message_and_exit_code_2(arguments, says, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    arguments = [str(one).replace("FILE", str(tmp_path / "file")) for one in arguments]
    result = reproduce(*(one.replace("toy", "shefex-spikes") for one in arguments))
    assert result.exit_code == 2
    assert result.stdout == ""
    assert says in result.output and "Traceback" not in result.output
