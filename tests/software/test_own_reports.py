"""What is said of flights with software of a user's own: of what it does not give, and of what failed."""

import json
import os
import re

import numpy as np
import pytest
from own_flights import reckoning, template

from shefex_nav import runs
from shefex_nav.log import topics
from shefex_nav.report import figures, metrics
from shefex_nav.report.viewer import layout, pages
from shefex_nav.scenario.load import load

SHORT = """extends: night_sky
mission: {name: mine, time_limit: 3 s}
star_tracker: {enabled: false, off: 3 s}
requirements: {misleading: 0 %}
navigation: {software: own.py:Reckoning}
"""


def short(folder, here="pass"):
    reckoning(folder, here)
    path = folder / "mine.yaml"
    path.write_text(SHORT)
    return path


def test_software_that_gives_its_covariance_has_a_nees(tmp_path):
    """Against the definition, from the records; the built-in filter's own is as it was, of its gates."""
    own = f"navigation.software={template('filter.py', tmp_path)}:MyFilter"
    flown = runs.fly(load("night_sky", [own], trust=True), until_s=6.0)
    assert {"gps_position", "gps_velocity", "star_tracker"} == {one.sensor for one in flown.data.gates}
    assert figures.draw("nis", flown.data) is not None
    data = flown.data._replace(gates=[])  # software that gives none
    nees = metrics.summarise(data)["navigation"]["nees"]
    assert nees["samples"] >= 4 and nees["dof"] == 9
    since = data.nav.t_s[np.flatnonzero(data.nav.star_aided)[0]]
    errors, expected = flown.errors(), []
    for k, t_s in enumerate(data.covariance.t_s):
        j = int(np.argmin(np.abs(errors.t_s - t_s)))
        if abs((t_s - data.mission.start_s) % 1.0 - 0.5) > 0.499 and t_s >= since:
            e = np.concatenate([errors.position_i[j], errors.velocity_i[j], errors.attitude_b[j]])
            expected.append(e @ np.linalg.solve(data.covariance.P[k], e))
    assert len(expected) == nees["samples"] and nees["mean"] == pytest.approx(np.mean(expected))
    assert "NEES" in [name for name, _ in metrics_rows(flown)]
    never = data._replace(nav=data.nav._replace(star_aided=np.zeros(len(data.nav.t_s), bool)))
    told = metrics.summarise(never)["navigation"]  # nothing was used: what came does not say where to begin
    assert told["nees"]["samples"] > nees["samples"] and "no star fix was used" in told["nees"]["why"]
    stars = told["measurements"]["star_tracker"]
    assert stars["delivered"] > 10 and (stars["used"], stars["refused"]) == (0, None)


def metrics_rows(flown):
    from shefex_nav.report import table

    return dict(table.rows(flown.summary()))["navigation"]


def test_biases_without_sigmas_have_no_band_and_say_so(tmp_path):
    own = f"navigation.software={template('filter.py', tmp_path)}:MyFilter"
    mine = runs.fly(load("night_sky", [own], trust=True), until_s=1.0)
    built_in = runs.fly(load("night_sky"), until_s=1.0)
    titles = [figures.draw("biases", one.data).texts[0].get_text() for one in (mine, built_in)]
    assert ["±3 σ" in one for one in titles] == [False, True]
    assert ["no σ of them" in one for one in titles] == [True, False]


def test_nothing_is_drawn_of_what_the_software_does_not_give(tmp_path):
    own = f"navigation.software={reckoning(tmp_path)}:Reckoning"
    flown = runs.fly(load("night_sky", [own], trust=True), until_s=2.0)
    assert flown.summary()["navigation"]["nees"]["mean"] is None
    for name in ("nis", "nees", "biases", "protection"):
        assert figures.draw(name, flown.data) is None, name
    assert figures.draw("position", flown.data) is not None
    has = layout.content(flown.data, [])
    assert (has.gates, has.covariance, has.biases, has.protection) == (False,) * 4
    shown = _origins(pages._navigation(flown.data, layout.scene(flown.data.truth.r_i), has))
    assert "plots/errors/position_x" in shown
    assert not {"plots/nis", "plots/nees", "plots/biases/gyro_bias_x"} & shown
    built_in = runs.fly(load("night_sky"), until_s=2.0)
    has = layout.content(built_in.data, [])
    shown = _origins(pages._navigation(built_in.data, layout.scene(built_in.data.truth.r_i), has))
    assert {"plots/nis", "plots/nees", "plots/biases/gyro_bias_x", "plots/protection/position"} <= shown


def _origins(part):
    """Origins of the views of a blueprint."""
    found = {str(part.origin)} if getattr(part, "origin", None) else set()
    return found.union(*(_origins(one) for one in getattr(part, "contents", []) if hasattr(one, "contents")))


def test_what_needs_levels_cannot_be_judged_of_software_without_them(tmp_path, command):
    log, page = tmp_path / "run.mcap", tmp_path / "page.html"
    run = command("run", str(short(tmp_path)), "--trust", "--out", str(log))
    said = re.sub(r"\s+", " ", run.out)
    assert "cannot be judged: the software gives no protection level" in said and "not met" not in said
    assert command("report", str(log), "--html", str(page)).code == 0
    assert "cannot be judged, the software gives no protection level: misleading." in page.read_text()
    how = ("--runs", "2", "--workers", "1", "--trust", "--out", str(tmp_path / "flown"))
    run = command("campaign", str(tmp_path / "mine.yaml"), *how)
    assert run.code == 0, run.err
    assert "Cannot be judged, the software gives no protection level: misleading." in run.out
    assert "misses misleading" not in run.out
    assert "nothing to judge: the software gives none" in run.out and "as chance would have it" not in run.out
    told = json.loads(command("report", str(tmp_path / "flown"), "--json").out)["requirements"]
    judged = {one["name"]: (one["passed"], one["of"], one["ci95"]) for one in told}
    assert judged["misleading"] == (0, 0, None)


def test_a_log_says_that_its_flight_failed(tmp_path, command):
    log = tmp_path / "run.mcap"
    run = command("run", str(short(tmp_path, "if self.ticks == 150: 1 / 0")), "--trust", "--out", str(log))
    assert run.code == 3
    data = runs.open_run(log).data
    last = data.events[-1]
    assert last.name == topics.FAILED and data.ended_early and data.failure == last.detail
    assert last.t_s == pytest.approx(1.5, abs=0.011) and abs(last.altitude_m - 600.0) < 1e4
    why = "T+1.50 s: failed in step (own.py:15): ZeroDivisionError: division by zero"
    assert why in data.failure and "failed at T+1.5" in repr(runs.open_run(log))
    report = command("report", str(log), "--html", str(tmp_path / "page.html"))
    assert report.code == 0 and "the flight failed" in report.err
    assert "ZeroDivisionError" in re.sub(r"\s+", " ", report.out)
    assert "The flight failed" in (tmp_path / "page.html").read_text()
    assert why in json.loads(command("report", str(log), "--json").out)["failure"]
    for words in (
        ("export", str(log), "--csv", str(tmp_path / "csv")),
        ("view", str(log), "--save", str(tmp_path / "a.rrd")),
    ):
        told = command(*words)
        assert told.code == 0 and f"{log}: the flight failed, " in told.err and why in told.err
    assert topics.FAILED in (tmp_path / "csv" / "events.csv").read_text()


def test_a_flight_that_did_not_fail_says_nothing_of_it(tmp_path, command):
    log = tmp_path / "run.mcap"
    assert command("run", str(short(tmp_path)), "--trust", "--out", str(log)).code == 0
    assert json.loads(command("report", str(log), "--json").out)["failure"] is None
    assert topics.FAILED not in [event.name for event in runs.open_run(log).events]


def test_a_run_is_not_repeated_with_software_that_was_edited(tmp_path, command):
    how = ("--runs", "1", "--workers", "1", "--trust", "--out", str(tmp_path / "flown"))
    assert command("campaign", str(short(tmp_path)), *how).code == 0
    flown = json.loads((tmp_path / "flown" / "campaign.json").read_text())["source"]
    reckoning(tmp_path, "pass  # edited")
    log = tmp_path / "0.mcap"
    run = command("repeat", str(tmp_path / "flown"), "0", "--log", str(log), "--trust")
    assert run.code == 2 and not log.exists() and "Traceback" not in run.err, run.err
    hashes = re.findall(r"([0-9a-f]{12})\.\.\.", run.err)
    assert len(set(hashes)) == 2 and hashes[1] in flown and hashes[0] not in flown
    assert "navigation.software: " in run.err and "put back what was flown" in run.err
    os.remove(tmp_path / "own.py")
    gone = command("repeat", str(tmp_path / "flown"), "0", "--trust")
    assert gone.code == 2 and "cannot be read" in gone.err
