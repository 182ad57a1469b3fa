"""`shefex-nav reproduce` as users meet it, with an experiment of the tests in the register."""

import json

import pytest
import toy
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.papers import registry
from shefex_nav.papers.verdict import TOO_FEW_WORDS, Verdict

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
    assert "a standard normal" in result.stdout and "differs, open [1]" in result.stdout
    assert "[1] there is nothing to measure it with" in result.stdout
    assert "200 numbers, seed 1" in result.stdout
    assert (out / "toy.png").read_bytes().startswith(b"\x89PNG")


def test_json_is_one_strict_object(toy_registered, tmp_path):
    result = reproduce("toy", "--samples", 200, "--seed", 7, "--out", tmp_path, "--json")
    assert result.exit_code == 0, result.output

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    found = json.loads(result.stdout, parse_constant=refuse)
    assert list(found) == [
        "version", "experiment", "title", "unit", "seed", "samples", "rows", "wall_s",
    ]  # fmt: skip
    assert (found["experiment"], found["seed"], found["samples"]) == ("toy", 7, 200)
    mean, impossible = found["rows"]
    columns = ["quantity", "condition", "published", "measured", "ci95", "verdict", "tolerance", "why", "run"]
    assert list(mean) == columns
    assert mean["ci95"][0] < mean["measured"] < mean["ci95"][1]
    assert mean["verdict"] == "reproduced" and mean["tolerance"] == 0.1
    assert impossible["measured"] is None and impossible["ci95"] is None
    assert impossible["verdict"] == "differs, open"
    assert json.loads((tmp_path / "toy.json").read_text()) == found


def test_a_sample_that_cannot_tell_says_so(toy_registered, tmp_path, monkeypatch):
    def undecided(results):
        return [toy.conclude(results)[0]._replace(verdict=Verdict.TOO_FEW, why=TOO_FEW_WORDS)]

    monkeypatch.setattr(registry, "load", lambda name: toy.NORMAL._replace(conclude=undecided))
    arguments = ("toy", "--samples", 2, "--out", tmp_path)
    shown = reproduce(*arguments).stdout
    assert "too few [1]" in shown and "differs" not in shown and "[1] too few samples" in shown
    (row,) = json.loads(reproduce(*arguments, "--json").stdout)["rows"]
    assert row["verdict"] == "too few" and row["why"] == TOO_FEW_WORDS


def test_all_is_an_object_of_experiments(toy_registered, tmp_path):
    result = reproduce("all", "--samples", 50, "--out", tmp_path, "--json")
    assert [one["experiment"] for one in json.loads(result.stdout)["experiments"]] == ["toy"]


def test_all_ends_with_the_rows_of_each_class_and_a_page(toy_registered, tmp_path):
    result = reproduce("all", "--samples", 50, "--out", tmp_path)
    assert result.exit_code == 0, result.output
    assert "Rows per class" in result.stdout
    total = result.stdout.splitlines()[-2].split("│")
    assert [cell.strip() for cell in total[1:-1]] == ["all", *"0010010000"]  # as Verdict has them
    page = (tmp_path / "report.html").read_text()
    assert "default-src 'none'" in page and "<script" not in page


def test_the_page_has_the_papers_side_by_side(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "EXPERIMENTS", {"toy": ("impa.toy", "a standard normal")})
    monkeypatch.setattr(registry, "load", lambda name: toy.NORMAL._replace(title="<b>bold</b>"))
    assert reproduce("toy", "--samples", 50, "--out", tmp_path).exit_code == 0
    result = reproduce("report", "--out", tmp_path)
    assert result.exit_code == 0, result.output
    page = (tmp_path / "report.html").read_text()
    assert "&lt;b&gt;bold&lt;/b&gt;" in page and "<b>bold" not in page
    assert "<h1>" in page and "&lt;h1&gt;" not in page
    assert page.count("data:image/png;base64,") == 1 and "IMPA" in page and "BRIGHT" not in page
    assert "there is nothing to measure it with" in page and "differs, open" in page
    (tmp_path / "toy.png").unlink()
    assert "toy.png is not beside" in " ".join(reproduce("report", "--out", tmp_path).output.split())


@pytest.mark.parametrize(
    "change", [{"version": "0.0.1"}, {"rows": [{"verdict": "reproduced"}]}, {"published": "1"}]
)
def test_results_of_another_version_are_no_page(toy_registered, tmp_path, change):
    assert reproduce("toy", "--samples", 50, "--out", tmp_path).exit_code == 0
    path = tmp_path / "toy.json"
    one = json.loads(path.read_text())
    if "published" in change:
        one["rows"][0] |= change
    else:
        one |= change
    path.write_text(json.dumps(one))
    result = reproduce("report", "--out", tmp_path)
    assert result.exit_code == 2 and "is no result of this version" in " ".join(result.output.split())


def test_a_figure_that_is_none_is_no_page(toy_registered, tmp_path):
    assert reproduce("toy", "--samples", 50, "--out", tmp_path).exit_code == 0
    (tmp_path / "toy.png").write_bytes(b"no")
    assert "toy.png is not beside" in " ".join(reproduce("report", "--out", tmp_path).output.split())


@pytest.mark.parametrize("content", [None, "[]", "{", '{"experiment": "toy"}', "[1]"])
def test_a_folder_without_results_is_refused(toy_registered, tmp_path, content):
    if content is not None:
        (tmp_path / "toy.json").write_text(content)
    result = reproduce("report", "--out", tmp_path)
    assert result.exit_code == 2 and "Traceback" not in result.output
    assert "reproduce" in result.output and not (tmp_path / "report.html").exists()


def test_the_default_sample_is_the_papers(toy_registered, tmp_path):
    result = reproduce("toy", "--out", tmp_path, "--json")
    assert json.loads(result.stdout)["samples"] == toy.NORMAL.samples


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("shefex-spike",), "shefex-spikes"),
        (("--json",), "--json: goes with an experiment or 'all'; without NAME they are listed"),
        (("report", "--samples", 9), "--samples: goes with an experiment or 'all'; report is the page"),
        (("toy", "--samples", 0), "--samples"),
        (("toy", "--samples", -3), "1 to 1000000000"),
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
