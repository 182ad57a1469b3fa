"""What differs between a scenario and what was flown, value by value."""

import json

from shefex_nav.campaign import plan
from shefex_nav.campaign.head import HEAD, differing
from shefex_nav.scenario import load

KNOWN = {"sampling": "random", "flight": "shared", "rate": 1.0}


def test_values_with_their_places(tmp_path, default_scenario):
    path = tmp_path / "top.yaml"
    path.write_text(
        f"extends: {default_scenario}\nlaunch: {{elevation: 85 deg}}\nwind: none\n", encoding="utf-8"
    )
    scenario = load.load(path, ["gps.max_pdop=6"])
    told = differing(scenario, default_scenario)
    assert told == [
        f"{default_scenario}: 2 values differ (there -> here):",
        f"{path}:2:21: launch.elevation: 86.43 deg -> 85 deg",
        "--set gps.max_pdop: gps.max_pdop: 10 -> 6",
    ]
    assert differing(scenario, path)[1:] == ["--set gps.max_pdop: gps.max_pdop: 10 -> 6"]


def test_a_campaign_in_its_folder(tmp_path, default_scenario):
    scenario = load.load(default_scenario)
    flown = {"format": plan.FORMAT, "source": scenario.source.replace("86.43 deg", "80 deg")}
    head = (
        {name: types[0]() for name, types in HEAD.items()}
        | {"sampling": "random", "flight": "shared", "rate": 1.0}
        | flown
        | {"runs": 1}
    )
    (tmp_path / "campaign.json").write_text(json.dumps(head), encoding="utf-8")
    assert differing(scenario, tmp_path)[1:] == [
        f"{scenario.place(('launch', 'elevation'))}: launch.elevation: 80 deg -> 86.43 deg"
    ]


def test_nothing_differs(default_scenario):
    assert differing(load.load(default_scenario), default_scenario) == [
        f"{default_scenario}: no value differs"
    ]


def test_a_value_that_is_taken_away_or_new_says_so(tmp_path, default_scenario):
    path = tmp_path / "top.yaml"
    text = f"extends: {default_scenario}\nvehicle: {{parachute: {{at: 450 s, drag_area: 4 m2, "
    path.write_text(text + "inflation: 2 s, station: 1.4 m}}\n", encoding="utf-8")
    told = differing(load.load(path), default_scenario)[1:]
    assert f"{path}:2:27: vehicle.parachute.at: (not given) -> 450 s" in told
    back = differing(load.load(default_scenario), path)[1:]
    assert any(line.endswith("vehicle.parachute.at: 450 s -> (not given)") for line in back)
