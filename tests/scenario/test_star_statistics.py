"""Statistics of the star tracker in a scenario: the model that is shipped, and what is refused."""

import json

import pytest
from broken import DEFAULT, messages, the_message

from shefex_nav.scenario import star_statistics
from shefex_nav.scenario.load import load, load_text

SHIPPED = DEFAULT.parent / "data" / "star_tracker_shefex2.json"
STATISTICAL = "star_tracker.frames=statistical"


def content():
    return json.loads(SHIPPED.read_text(encoding="utf-8"))


def with_model(folder, change, digest=star_statistics.digest):
    """Overrides that fly the default scenario with the shipped model after `change`, as if so fitted."""
    found = content()
    change(found)
    found["digest"] = digest(found)
    path = folder / "model.json"
    path.write_text(json.dumps(found), encoding="utf-8")
    return path, [STATISTICAL, f"star_tracker.model={path}"]


def test_shipped_model_is_of_the_default_scenario_and_its_campaign():
    found = content()
    assert found["digest"] == star_statistics.digest(found)
    for name in ("shefex2_andoya.yaml", "shefex2_dispersed.yaml"):
        scenario = load(DEFAULT.with_name(name), [STATISTICAL])  # refused with any other setting
        assert set(found["settings"]) == set(star_statistics.settings(scenario))
    assert all(test["good"] for test in found["tests"]) and len(found["tests"]) >= 15
    for test in found["tests"]:
        assert test["low"] <= test["value"] <= test["high"]
    assert found["made"]["runs"] >= 6 and found["made"]["held_out"] >= 3


def test_statistics_hold_for_the_default_scenario_and_those_with_the_same_star_tracker():
    scenario = load(DEFAULT, [STATISTICAL])
    assert scenario.star_tracker.model.digest == content()["digest"]
    load(DEFAULT.with_name("imu_300ppm.yaml"), [STATISTICAL])
    for other in ("star_tracker.on=240 s", "star_tracker.latency=40 ms", "gps.range_noise=3 m"):
        load(DEFAULT, [STATISTICAL, other])


def test_the_text_that_a_log_keeps_needs_no_file_and_knows_no_path():
    scenario = load(DEFAULT, [STATISTICAL])
    again = load_text(scenario.source, "kept")
    assert again.star_tracker.model == scenario.star_tracker.model
    assert "star_tracker_shefex2.json" not in load(DEFAULT).source


@pytest.mark.parametrize(
    ("override", "field", "words"),
    [
        (
            "star_camera.optics.psf_sigma=1.5 pix",
            "star_camera.optics.psf_sigma",
            "is 1.5 pix, the statistics of the star tracker were fitted to 0.55",
        ),
        (
            "star_tracker.exposure.longest=45 ms",
            "star_tracker.exposure.longest",
            "is 45 ms, the statistics of the star tracker were fitted to 50 ms",
        ),
        ("star_tracker.highest_rate=3 deg/s", "star_tracker.highest_rate", "is 3 deg/s, the statistics"),
        ("star_tracker.identification.method=pyramid", "star_tracker.identification.method", "is pyramid"),
        (
            "star_tracker.catalogue.faintest=6 mag",
            "star_tracker.catalogue.faintest",
            "is 6 mag, the statistics of the star tracker were fitted to 5.5 mag",
        ),
        (
            "star_camera.stray_light.baffle=40 deg",
            "star_camera.stray_light.baffle",
            "characterise this scenario",
        ),
    ],
)
def test_other_settings_are_refused(override, field, words):
    extra = ["star_tracker.identification.tracking=false"] if "method" in override else []
    extra += ["star_tracker.exposure.start=45 ms"] if "longest" in override else []
    said = messages(DEFAULT, [STATISTICAL, override, *extra])
    mine = [line for line in said if f"{field}: " in line]
    assert len(mine) == 1 and words in mine[0], said
    assert len(said) == 1 + len(extra)
    load(DEFAULT, [override, *extra])  # rendered it flies


def test_a_range_of_a_setting_is_a_range(tmp_path):
    def widen(found):
        found["settings"]["star_camera.optics.psf_sigma"] = [0.75, 0.85]

    _, overrides = with_model(tmp_path, widen)
    for inside in ("0.75 pix", "0.8 pix", "0.85 pix"):
        load(DEFAULT, [*overrides, f"star_camera.optics.psf_sigma={inside}"])
    said = the_message(DEFAULT, [*overrides, "star_camera.optics.psf_sigma=0.86 pix"])
    assert "is 0.86 pix, the statistics of the star tracker were fitted to 0.75 pix to 0.85 pix" in said


def test_a_model_that_is_missing_broken_or_of_something_else_is_refused(tmp_path):
    assert "star_tracker.model: frames: statistical needs" in the_message(
        DEFAULT, [STATISTICAL, "star_tracker.model=null"]
    )
    nowhere = tmp_path / "nowhere.json"
    said = the_message(DEFAULT, [STATISTICAL, f"star_tracker.model={nowhere}"])
    assert f"star_tracker.model: '{nowhere}' there is no such file" in said
    assert load(DEFAULT, [f"star_tracker.model={nowhere}"]).star_tracker.model is None
    path, overrides = with_model(tmp_path, lambda found: found["sightings"].pop("noise"))
    assert "star_tracker.model.sightings.noise: " in the_message(DEFAULT, overrides)
    path.write_text("[1, 2]", encoding="utf-8")
    assert f"{path}:1:1: this is no file of shefex-nav characterise" in the_message(DEFAULT, overrides)
    path.write_text('{"format": 1,', encoding="utf-8")
    assert f"{path}:1:" in the_message(DEFAULT, overrides)
    _, overrides = with_model(tmp_path, lambda found: found.update(format=1))
    assert "star_tracker.model.format" in the_message(DEFAULT, overrides)
    _, overrides = with_model(tmp_path, lambda found: found["settings"].pop("star_tracker.rate"))
    assert "does not say for which star_tracker.rate it was made" in the_message(DEFAULT, overrides)


def test_a_model_that_was_changed_after_it_was_written_is_refused(tmp_path):
    def better(found):
        found["sightings"]["noise"][1] *= 0.5

    _, overrides = with_model(tmp_path, better, lambda found: found["digest"])
    said = the_message(DEFAULT, overrides)
    assert "star_tracker.model: is not as shefex-nav characterise wrote it: it should have the digest" in said
    assert content()["digest"] in said and "characterise again" in said
    load(DEFAULT, with_model(tmp_path, better)[1])
    load(DEFAULT, with_model(tmp_path, lambda found: found.update(tests=[], made={"by": "me"}))[1])


def test_a_rolling_shutter_has_no_statistics():
    said = messages(DEFAULT.with_name("shefex2_aps_rolling.yaml"), [STATISTICAL])
    assert any(
        "star_tracker.frames: statistics of the star tracker are of a global shutter" in s for s in said
    )
    rolling = [line for line in messages(DEFAULT.with_name("shefex2_aps_rolling.yaml"), [STATISTICAL])]
    assert any(
        "star_tracker.frames: statistics of the star tracker are of a global shutter" in line
        for line in rolling
    )
