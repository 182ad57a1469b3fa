"""One run of a campaign again, compared with its row and with what `report` says of its log."""

import json

import keeping
import pytest
from short_campaign import HereLane, fly, write
from typer.testing import CliRunner

from shefex_nav.campaign import repeating, store
from shefex_nav.commands.app import app
from shefex_nav.scenario import load

RUNS = 4


def larger(record):
    """A run whose largest error is not what it was."""
    record["summary"]["navigation"]["velocity_error_m_s"]["max"] += 1e-9


def test_repeat_says_whether_it_is_the_same(whole, tmp_path, scenario):
    folder, _ = whole
    repeated = repeating.repeat(folder, 3, lane=HereLane)
    assert repeated.same and repeated.words() == "run 3: succeeded; the same as its row"
    fly(scenario, tmp_path, 1)
    keeping.change(tmp_path, 0, larger)
    changed = repeating.repeat(tmp_path, 0, lane=HereLane)
    assert list(changed.differences) == ["summary.navigation.velocity_error_m_s.max"] and not changed.same
    with pytest.raises(store.StoreError, match="has runs 0 to 0, there is no run 1"):
        repeating.repeat(tmp_path, 1)
    with pytest.raises(store.StoreError, match=r"there is no campaign\.json"):
        repeating.repeat(tmp_path / "logs", 0)


def test_an_old_log_is_not_called_the_new_one(tmp_path):
    """A run that fails before its first record writes none; `--force` let the old file be there."""
    (tmp_path / "step.csv").write_text("step_s\n0.06\n0.04\n")
    more = "  star_tracker.exposure.start: {table: {file: step.csv, column: step_s, unit: s}}\n"
    fails = load.load(write(tmp_path, more), ["star_tracker.exposure.shortest=10 ms"])
    fly(fails, tmp_path / "campaign", 1)
    old = tmp_path / "old.mcap"
    old.write_bytes(b"mine")
    repeated = repeating.repeat(tmp_path / "campaign", 0, old, lane=HereLane)
    assert repeated.same and repeated.record["status"] == "failed"
    assert repeated.log is None and repeated.result()["log"] is None and old.read_bytes() == b"mine"


def test_a_log_has_more_than_the_figures_of_a_campaign_and_that_is_said(whole, tmp_path, monkeypatch):
    """A row against `report` of the log of its run, as people compare them: near, not the same."""
    folder, _ = whole
    monkeypatch.setattr(repeating.repeat, "__kwdefaults__", {"lane": HereLane})
    arguments = ["repeat", str(folder), "1", "--log", str(tmp_path / "1.mcap")]
    said = CliRunner().invoke(app, arguments)
    assert said.exit_code == 0 and "the same as its row" in said.stdout
    assert "the log has truth and solution at 100 Hz, a campaign's figures are of 10 Hz" in said.stderr
    told = json.loads(CliRunner().invoke(app, ["report", str(tmp_path / "1.mcap"), "--json"]).stdout)
    row = keeping.rows(folder)[1]
    for name in ("position_error_m", "velocity_error_m_s", "attitude_error_deg"):
        rms, largest = (row[f"summary.navigation.{name}.{what}"] for what in ("rms", "max"))
        assert told["navigation"][name]["rms"] == pytest.approx(rms, rel=0.1)
        assert told["navigation"][name]["max"] >= largest
    assert told["navigation"]["velocity_error_m_s"]["rms"] != row["summary.navigation.velocity_error_m_s.rms"]
    quiet = repeating.repeat(folder, 1, lane=HereLane)
    assert quiet.notes == []


def test_a_shared_flight_that_is_spoilt_is_one_message(tmp_path):
    path = write(tmp_path)
    path.write_text(path.read_text().replace("  ground.latitude: {uniform: [-1 deg, 1 deg]}\n", ""))
    fly(load.load(path, ["campaign.flight=shared"]), tmp_path / "campaign", 1)
    kept = tmp_path / "campaign" / "flight.npz"
    kept.write_bytes(kept.read_bytes()[:-1] + b"?")
    with pytest.raises(store.StoreError, match="is not what the runs flew; `shefex-nav campaign` makes it"):
        repeating.repeat(tmp_path / "campaign", 0, lane=HereLane)
    kept.unlink()
    with pytest.raises(store.StoreError, match="is not there"):
        repeating.repeat(tmp_path / "campaign", 0, lane=HereLane)
