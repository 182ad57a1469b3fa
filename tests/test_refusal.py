"""What the command line cannot take is one plain line on stderr, exit code 2, and nothing is computed."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from rich.table import Table

from shefex_nav.commands import printing
from shefex_nav.commands.app import main
from shefex_nav.commands.output_files import OF_CAMPAIGNS

SHIPPED = Path(__file__).parents[1] / "scenarios"
LOG, THERE = "{log}", "{there}"  # files that exist

REFUSALS = {
    ("run", "x.yaml", "--seed", "four"): "--seed four: expected a whole number",
    ("run", "x.yaml", "--seed", "1.5"): "--seed 1.5: expected a whole number",
    ("run", "x.yaml", "--seed", "-1"): "--seed -1: must be at least 0",
    ("campaign", "x.yaml", "--runs", "0"): "--runs 0: must be at least 1",
    ("campaign", "x.yaml", "--runs", "10000001"): "--runs 10000001: must be at most 10000000",
    ("impact", "x.yaml", "--runs", "9" * 21): f"--runs {'9' * 21}: must be at most 10000000",
    ("verify", "bound", "x.yaml", "--seeds", "100001"): "--seeds 100001: must be at most 100000",
    ("verify", "consistency", "x.yaml", "--seeds", "9999999"): "--seeds 9999999: must be at most 100000",
    ("campaign", "x.yaml"): "--runs: is missing; see `shefex-nav campaign --help`",
    ("solve", "x.png", "--epoch", "today"): (
        "--epoch: expected UTC in ISO 8601, such as 2012-06-22 or 2012-06-22T19:22:00.5, got 'today'"
    ),
    ("repeat", "folder", "last"): "RUN last: expected a whole number",
    ("run",): "SCENARIO: is missing; see `shefex-nav run --help`",
    ("view",): "LOG...: is missing; see `shefex-nav view --help`",
    (
        "run",
        "x.yaml",
        "--sed",
        "1",
    ): "--sed: `shefex-nav run` has no such option; did you mean --seed or --set?",
    ("run", "x.yaml", "--seed"): "--seed: expects a value",
    ("run", "x.yaml", "--json=3"): "--json: takes no value",
    ("run", "x.yaml", "y.yaml"): "y.yaml: more than `shefex-nav run` expects; see `shefex-nav run --help`",
    ("rn", "x.yaml"): "rn: no such command; did you mean 'run'?",
    ("verify", "x"): "x: no such command; see `shefex-nav verify --help`",
    ("run", "{default}", "--out", THERE): "--out: {there} exists already; choose another name or add --force",
    ("run", "{default}", "--pace", "1_0"): "--pace 1_0: expected a number",
    ("verify", "bound", "{default}", "--seeds", "1_0"): "--seeds 1_0: expected a whole number",
    ("repeat", "{there}.d", "1_0"): "RUN 1_0: expected a whole number",
    ("impact", "{default}", "--aim", "6_8,20"): "--aim: '6_8,20' is no place; expected such as 68.4,20.9",
    ("run", "{default}", "--out", "{there}.d/x"): "--out: there is no folder {there}.d",
    ("report", LOG, "--html", THERE): "--html: {there} exists already; choose another name or add --force",
    (
        "export",
        LOG,
    ): "nothing to write: name at least one of --csv DIR, --parquet DIR, --replay DIR, --kml FILE, "
    "--geojson FILE, --frames DIR",
    ("view", LOG, "--at", "3 s"): "--at: 3 s is the time of a picture; name it with --screenshot",
    (
        "view",
        LOG,
        "--at",
        "3",
        "--screenshot",
        "x.png",
    ): "--at: '3' has no unit; write it with one, for example '3 s'",
    ("view", LOG, "--view", "stars"): (
        "--view: 'stars' is no page; choose from: overview, mission, star-tracker, navigation, sensors"
    ),
    ("view", LOG, "--save", THERE): "--save: {there} exists already; choose another name or add --force",
    ("view", LOG, "--save", LOG, "--force"): "--save: {log} is the log itself; choose another name",
    ("view", LOG, "--web", "--save", "x.rrd"): "--web: does not go with --save or --screenshot",
    ("replay", LOG): "{log}: not an MCAP file",
    ("report", LOG): "{log}: not an MCAP file",
    (
        "check",
        LOG,
    ): "{log}:1:1: the file holds a single value; expected a mapping that starts with 'mission:'",
    ("report", LOG, "--html", LOG, "--force"): "--html: {log} is the log itself; choose another name",
    ("export", LOG, "--kml", LOG, "--force"): "--kml: {log} is the log itself; choose another name",
    ("run", "{default}", "--out", "{default}", "--force"): (
        "--out: {default} is a file that is read here; choose another name"
    ),
    ("export", LOG, "--kml", "{there}.x", "--geojson", "{there}.x"): (
        "--geojson: {there}.x is that of --kml too; give each its own"
    ),
    ("export", LOG, "--kml", "{there}.x", "--csv", "{there}.x"): (
        "--kml: {there}.x is that of --csv too; give each its own"
    ),
    ("export", LOG, "--csv", "{there}.x", "--frames", "{there}.x"): (
        "--frames: {there}.x is that of --csv too; give each its own"
    ),
    ("export", LOG, "--parquet", "{there}.x", "--kml", "{there}.x/columns.csv"): (
        "--kml: {there}.x/columns.csv is in the folder of --parquet, whose files it may overwrite; "
        "give it another place"
    ),
    ("report", LOG, "--html", "{there}.x", "--figures", "{there}.x"): (
        "--figures: {there}.x is that of --html too; give each its own"
    ),
    ("solve", "x.png", "--overlay", "{there}.x", "--stages", "{there}.x"): (
        "--overlay: {there}.x is that of --stages too; give each its own"
    ),
    ("view", LOG, "--save", "{there}.x", "--screenshot", "{there}.x"): (
        "--screenshot: {there}.x is that of --save too; give each its own"
    ),
    ("compare", LOG, LOG, "--html", "{there}.x", "--out", "{there}.x"): (
        "--html: {there}.x is that of --out too; give each its own"
    ),
    ("characterise", "{default}", "--runs", "6", "--out", "{there}.x", "--records", "{there}.x"): (
        "--records: {there}.x is that of --out too; give each its own"
    ),
    ("verify", "consistency", "{default}", "--out", "{there}.png", "--keep", "{there}.png"): (
        "--keep: {there}.png is that of --out too; give each its own"
    ),
    ("compare", LOG, "built-in", "--html", LOG, "--force"): (
        "--html: {log} is the log itself; choose another name"
    ),
    ("characterise", "{default}", "--runs", "6", "--out", "{default}", "--force"): (
        "--out: {default} is a file that is read here; choose another name"
    ),
    ("campaign", "{default}", "--runs", "2", "--out", THERE): (
        "--out: {there} is a file; give the name of a folder"
    ),
    ("repeat", "{there}.d", "0"): "{there}.d: there is no campaign.json; expected the folder of a campaign",
}


@pytest.mark.parametrize("arguments", REFUSALS, ids=" ".join)
def test_one_plain_line(arguments, tmp_path, monkeypatch, capsys, default_scenario):
    names = {"log": tmp_path / "run.mcap", "there": tmp_path / "there", "default": default_scenario}
    for name in ("log", "there"):
        names[name].write_bytes(b"precious")
    monkeypatch.setattr("sys.argv", ["shefex-nav", *(word.format(**names) for word in arguments)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    assert ended.value.code == 2
    assert printed.err == REFUSALS[arguments].format(**names) + "\n"
    assert printed.out == ""
    assert {path.name for path in tmp_path.iterdir()} == {"run.mcap", "there"}
    assert all(names[name].read_bytes() == b"precious" for name in ("log", "there"))


@pytest.mark.parametrize("link", [os.link, os.symlink], ids=["hard", "symbolic"])
@pytest.mark.parametrize(
    "arguments",
    [
        ("run", "{read}", "--out", "{link}"),
        ("vehicle", "{read}", "--output", "{link}"),
        ("characterise", "{read}", "--runs", "6", "--out", "{link}"),
        ("rare", "{read}", "--of", "apogee < 1 km", "--output", "{folder}"),
        ("impact", "{read}", "--output", "{folder}"),
        ("smooth", "{read}", "--out", "{link}"),
        ("compare", "{read}", "built-in", "--html", "{link}"),
    ],
    ids=lambda words: words[0],
)
def test_a_link_to_what_is_read_is_not_overwritten(arguments, link, tmp_path, monkeypatch, capsys):
    name = {"rare": "rare.json", "impact": "impact.json", "vehicle": "a.html"}.get(arguments[0], "link")
    read, other = tmp_path / "read.yaml", tmp_path / "folder" / name
    other.parent.mkdir()
    base = "night_sky.yaml" if arguments[0] == "characterise" else "rexus_like.yaml"
    read.write_text(f"extends: {SHIPPED / base}\n")
    link(read, other)
    told = {"read": read, "link": other, "folder": other.parent}
    words = [word.format(**told) for word in arguments]
    monkeypatch.setattr("sys.argv", ["shefex-nav", *words, "--force"])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr().err
    assert ended.value.code == 2 and said.count("\n") == 1
    assert re.match(
        rf"--(out|output|html): {re.escape(str(other))} is (a file that is read|the log)", said
    ), said
    assert read.read_text().startswith("extends: ") and other.samefile(read)


PICTURES = {
    ("trade", "x.yaml", "--sweep", "gps.rate=1 Hz,2 Hz"): "--figure",
    ("winds", "x.yaml", "--within", "20 km"): "--figure",
    ("verify", "bound", "x.yaml"): "--out",
    ("verify", "consistency", "x.yaml"): "--out",
    ("verify", "nesc", "--data", "x"): "--out",
    ("solve", "x.png"): "--overlay",
}


@pytest.mark.parametrize("arguments", PICTURES, ids=" ".join)
def test_a_picture_that_is_there_is_kept_unless_it_is_forced(arguments, tmp_path, monkeypatch, capsys):
    picture, option = tmp_path / "picture.png", PICTURES[arguments]
    picture.write_bytes(b"precious")
    for more in ((), ("--force",)):
        monkeypatch.setattr("sys.argv", ["shefex-nav", *arguments, option, str(picture), *more])
        with pytest.raises(SystemExit) as ended:
            main()
        said = f"{option}: {picture} exists already; choose another name or add --force\n"
        assert ended.value.code == 2 and (capsys.readouterr().err == said) is (not more)
        assert picture.read_bytes() == b"precious"  # x is missing: nothing is drawn


@pytest.mark.parametrize("name", OF_CAMPAIGNS)
def test_files_of_campaigns_are_not_overwritten_by_force(name, tmp_path, monkeypatch, capsys):
    path = tmp_path / name
    path.write_bytes(b"precious")
    for arguments in (("report", "x", "--html"), ("repeat", "x", "0", "--log")):
        monkeypatch.setattr("sys.argv", ["shefex-nav", *arguments, str(path), "--force"])
        with pytest.raises(SystemExit) as ended:
            main()
        said = f"{arguments[-1]}: {path} is a file of a campaign; choose another name\n"
        assert ended.value.code == 2 and capsys.readouterr().err == said
        assert path.read_bytes() == b"precious"


def test_what_a_terminal_would_obey_is_written_out(tmp_path, monkeypatch, capsys):
    path = tmp_path / "x.yaml"
    path.write_text('extends: night_sky\nearth: {"pole\\e]0;T\\a\\u202e": 1}\n')
    monkeypatch.setattr("sys.argv", ["shefex-nav", "check", str(path)])
    with pytest.raises(SystemExit):
        main()
    assert r"earth.pole\x1b]0;T\x07\u202e: unknown key" in capsys.readouterr().err
    assert printing.visible("a\tb\nc é \x9b31m[b]\r") == "a\tb\nc é \\x9b31m[b]\\r"
    printing.stdout(60).print(Table("[b]\x1b[31mhead", title="\x1b]2;t\x07"))
    printed = capsys.readouterr().out
    assert r"[b]\x1b[31m" in printed and r"\x1b]2;t" in printed and "\x1b" not in printed


def ends(words, **how):
    """Exit code and messages of a command of its own process."""
    done = subprocess.run([sys.executable, "-m", "shefex_nav", *words], stderr=subprocess.PIPE, **how)
    return done.returncode, done.stderr.decode()


def test_a_reader_that_has_gone_is_no_answer():
    read, write = os.pipe()
    os.close(read)
    assert ends(["scenarios"], stdout=write) == (141, "")


@pytest.mark.skipif(os.name != "posix", reason="file descriptors as there")
def test_standard_output_that_is_closed_loses_no_result_unsaid():
    code, said = ends(["scenarios"], preexec_fn=lambda: os.close(1))
    assert code == 2 and said == "the output cannot be written: Bad file descriptor\n"


def test_without_arguments_there_is_help(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["shefex-nav"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    printed = capsys.readouterr()
    assert "Commands" in printed.out + printed.err


def test_exit_codes_of_commands_stay(monkeypatch, tmp_path, default_scenario):
    monkeypatch.setattr("sys.argv", ["shefex-nav", "check", str(default_scenario)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
@pytest.mark.parametrize("name, code", [("night_sky", 0), ("nowhere", 2)])
def test_standard_error_that_cannot_be_written_is_no_error(name, code):
    command = [sys.executable, "-m", "shefex_nav", "check", name]
    with open("/dev/full", "w") as full:
        assert subprocess.run(command, stdout=subprocess.PIPE, stderr=full, check=False).returncode == code
