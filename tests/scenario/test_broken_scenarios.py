"""Broken scenarios, each of one kind: one clear message with file, line, column and field."""

import re

import pytest
from broken import DEFAULT, TEXT, check_one_message, messages, the_message

# kind: (text in the default scenario, what stands there instead, where "@" is the place complained about,
#        field, words, and other lines that make the mistake one)
BROKEN = {
    "bare number": ("rate: 10 Hz", "rate: @10", "star_tracker.rate", "10 has no unit; write it with one"),
    "wrong dimension": (
        "rate: 10 Hz",
        "rate: @10 m",
        "star_tracker.rate",
        "is a length, expected a frequency",
    ),
    "unknown unit": ("rate: 10 Hz", "rate: @10 Hzz", "star_tracker.rate", "did you mean Hz?"),
    "no number": ("rate: 10 Hz", "rate: @fast", "star_tracker.rate", "cannot read 'fast'"),
    "NaN": ("rate: 10 Hz", "rate: @.nan", "star_tracker.rate", "must be a finite number, got nan"),
    "NaN with unit": ("rate: 10 Hz", "rate: @nan Hz", "star_tracker.rate", "must be a finite number"),
    "infinity": ("rate: 10 Hz", "rate: @.inf", "star_tracker.rate", "must be a finite number, got inf"),
    "negative rate": ("rate: 10 Hz", "rate: @-10 Hz", "star_tracker.rate", "must be greater than zero"),
    "nothing": (
        "rate: 10 Hz",
        "@rate:",
        "star_tracker.rate",
        "expected a quantity such as '10 Hz', got nothing",
    ),
    "missing key": (
        "@star_tracker:\n  enabled: true\n",
        "@star_tracker:\n",
        "star_tracker.enabled",
        "is missing",
    ),
    "misspelt key": (
        "rate: 10 Hz",
        "@ratte: 10 Hz",
        "star_tracker.ratte",
        "unknown key; did you mean 'rate'?",
    ),
    "unknown key": (
        "rate: 10 Hz",
        "rate: 10 Hz\n  @colour: red",
        "star_tracker.colour",
        "known here: enabled, on",
    ),
    "duplicate key": (
        "rate: 10 Hz",
        "rate: 10 Hz\n  @rate: 5 Hz",
        "star_tracker.rate",
        "duplicate key, already given",
    ),
    "misspelt section": (
        "\npad_alignment:",
        "\n@pad_alignement:",
        "pad_alignement",
        "did you mean 'pad_alignment'?",
    ),
    "value for a section": (
        "  spin:\n    threshold: 90 deg/s\n    loss: 20 %\n    noise_factor: 2\n",
        "  spin: @off\n",
        "gps.spin",
        "expected a section with keys of its own, got 'off'",
    ),
    "gram for standard gravity": (
        "bias: 0.5 mgee",
        "bias: @0.5 mg",
        "imu.accelerometer.bias",
        "g is the gram",
    ),
    "unknown star catalogue": (
        "kind: magnitude_limited",
        "kind: @hipparcos",
        "star_tracker.catalogue.kind",
        "'hipparcos' is not known; choose from: magnitude_limited, asymmetric, uniform, combined",
    ),
    "misspelt star catalogue": (
        "kind: magnitude_limited",
        "kind: @combind",
        "star_tracker.catalogue.kind",
        "did you mean 'combined'?",
    ),
    "southern limit beyond the catalogue": (
        "kind: magnitude_limited # or asymmetric, uniform, combined\n    system: V\n",
        "kind: asymmetric\n    system: V\n    faintest_south: @9 mag\n",
        "star_tracker.catalogue.faintest_south",
        "8 mag",
    ),
    "prediction for a method that takes none": (
        "method: bayes # or pyramid (as flown), brightness, voting, multipole\n    tracking: true",
        "method: pyramid\n    tracking: @true",
        "star_tracker.identification.tracking",
        "method 'pyramid' cannot use a prediction; set tracking: false",
    ),
    "published acceptance of a method that is published nowhere": (
        "fewest_stars: 4\n",
        "fewest_stars: 4\n    acceptance: @published\n",
        "star_tracker.identification.acceptance",
        "'bayes' is published nowhere; write verified, or choose another method",
    ),
    "three stars that are to be verified": (
        "fewest_stars: 4\n",
        "fewest_stars: @3\n",
        "star_tracker.identification.fewest_stars",
        "3 stars prove nothing; write 4, or acceptance: published",
    ),
    "a cosError for a method without one": (
        "fewest_stars: 4\n",
        "fewest_stars: 4\n    cosine_error: @5.5e-5\n",
        "star_tracker.identification.cosine_error",
        "is of the published pyramid; write acceptance: published, or leave it out",
    ),
    "a reference magnitude for a method without one": (
        "fewest_stars: 4\n",
        "fewest_stars: 4\n    reference_magnitude: @2 mag\n",
        "star_tracker.identification.reference_magnitude",
        "method 'bayes' has none; leave it out",
    ),
    "unknown identification": (
        "method: bayes",
        "method: @telepathy",
        "star_tracker.identification.method",
        "'telepathy' is not known; choose from: bayes, pyramid, brightness, voting, multipole",
    ),
    "rolling shutter without times": (
        "    scan: sequential",
        "    scan: streaks",
        "star_camera.detector.line_time",
        "a rolling shutter needs it; such as 60 us",
        "    shutter: rolling",
    ),
    "row times of a global shutter": (
        "    readout: 15 ms",
        "    line_time: @60 us\n    readout: 15 ms",
        "star_camera.detector.line_time",
        "a global shutter exposes all rows at once; write shutter: rolling or leave it out",
    ),
    "rolling shutter and spots at rest": (
        "    scan: sequential",
        "    scan: @maximum",
        "star_tracker.detection.scan",
        "'maximum' takes all rows for exposed at once, which a rolling shutter does not do; choose streaks",
        "    line_time: 60 us\n    shutter: rolling",
    ),
    "rows too slow for the frames": (
        "    shutter: global",
        "    shutter: rolling\n    line_time: @250 us",
        "star_camera.detector.line_time",
        "493 rows take 123.25 ms to read out, the frames follow each other after 100 ms; 202.8 us is",
        "    scan: streaks",
    ),
    "rows exposed longer than the frames take": (
        "    longest: 50 ms",
        "    longest: @110 ms",
        "star_tracker.exposure.longest",
        "every row is exposed for 110 ms, the frames follow each other after 100 ms",
        "    scan: streaks",
        "    line_time: 60 us\n    shutter: rolling",
    ),
    "brighter than the detector": (
        "    saturation: automatic",
        "    saturation: @1023 DN",
        "star_tracker.detection.saturation",
        "1023 DN is above 255 DN, the largest grey value of 8 bits",
    ),
    "mean brighter than the detector": (
        "    brightest_mean: 100 DN",
        "    brightest_mean: @512 DN",
        "star_tracker.exposure.brightest_mean",
        "512 DN is above 511 DN, the largest grey value of 9 bits",
        "    bits: 9",
    ),
    "saturation of a detector of 8 bits": (
        "    saturation: automatic",
        "    saturation: @255.0 DN",
        "star_tracker.detection.saturation",
        "255 DN is less than a quarter of 4095 DN, the largest grey value of 12 bits: most stars would count",
        "    bits: 12",
    ),
    "nothing between black and saturated": (
        "    saturation: automatic",
        "    saturation: @16 DN",
        "star_tracker.detection.saturation",
        "must be above star_camera.detector.black_level, 16 DN",
    ),
    "streaks with another centroid": (
        "    centroid: fit",
        "    centroid: @centre_of_mass",
        "star_tracker.detection.centroid",
        "scan 'streaks' brings its own way along; write centroid: fit",
        "    scan: streaks",
    ),
    "clusters with gaps between the frames": (
        "    shortest: 35 ms",
        "    shortest: @90 ms",
        "star_tracker.exposure.shortest",
        "there must be no gap: 90 ms must be 100 ms, the interval of star_tracker.rate",
        "    scan: run_length",
        "    centroid: weighted",
        "    start: 100 ms",
        "    longest: 100 ms",
        "    readout: 0 ms",
    ),
    "window that is no power of two": (
        "      window: 256",
        "      window: @100",
        "star_tracker.detection.run_length.window",
        "100 is not a power of two",
    ),
    "yes for true": (
        "enabled: true",
        "enabled: @yes",
        "star_tracker.enabled",
        "expected true or false, got 'yes'",
    ),
    "fraction of a pixel": (
        "columns: 659",
        "columns: @659.5",
        "star_camera.detector.columns",
        "expected a whole number",
    ),
    "short vector": (
        "[0.6 m, 0.05 m, -0.03 m]",
        "@[0.6 m, 0.05 m]",
        "gps.antenna.lever_arm",
        "expected a list of 3 values, got 2",
    ),
    "long vector": (
        "[0.6 m, 0.05 m, -0.03 m]",
        "@[0 m, 0 m, 0 m, 0 m]",
        "gps.antenna.lever_arm",
        "expected a list of 3 values, got 4",
    ),
    "bare component": (
        "[0.6 m, 0.05 m, -0.03 m]",
        "[0.6 m, @0.05, -0.03 m]",
        "gps.antenna.lever_arm.1",
        "0.05 has no unit",
    ),
    "scalar for a vector": (
        "[0.6 m, 0.05 m, -0.03 m]",
        "@0.6 m",
        "gps.antenna.lever_arm",
        "expected a list of 3 values",
    ),
    "latitude": (
        "latitude: 69.2942 deg",
        "latitude: @169 deg",
        "launch.latitude",
        "must be at most 90 deg, got '169 deg'",
    ),
    "spikes": (  # 17 s and 10 GB for a frame
        "spikes_per_frame: 0.2",
        "spikes_per_frame: @2e8",
        "star_camera.artefacts.spikes_per_frame",
        "must be at most 10000, got 200000000.0",
    ),
    "misalignment": (  # the filter divided by zero
        "misalignment: 0.05 mrad",
        "misalignment: @1e9 mrad",
        "imu.gyro.misalignment",
        "must be at most 1 rad, got '1e9 mrad'",
    ),
    "level": (  # two angles that no linear filter can start from
        "level: 0.05 deg",
        "level: @21 deg",
        "pad_alignment.level",
        "must be at most 20 deg, got '21 deg'",
    ),
    "date": (
        "epoch: 2012-06-22",
        "epoch: @2012-06-32",
        "mission.epoch",
        "cannot read '2012-06-32T19:18:00Z' as a date",
    ),
    "time zone": ("19:18:00Z", "19:18:00+02:00", "mission.epoch", "is not marked as UTC; end it with Z"),
    "file name": ("name: shefex2_andoya", "name: @a/b", "mission.name", "must be one word of letters"),
    "start between ticks": (
        "start: -10 s",
        "start: @-10.005 s",
        "mission.start",
        "must be a multiple of 0.1 s",
    ),
    "rate against clock": (
        "rate: 10 Hz",
        "rate: @7 Hz",
        "star_tracker.rate",
        "7 Hz does not divide the on-board clock, 100 Hz",
    ),
    "exposure over interval": (
        "longest: 50 ms",
        "longest: @120 ms",
        "star_tracker.exposure.longest",
        "take 135 ms, the frames follow each other after 100 ms",
    ),
    "window after the mission": (
        "  off: 385 s",
        "  off: @700 s",
        "star_tracker.off",
        "is after mission.time_limit",
    ),
    "window inside out": (
        "  off: 385 s",
        "  off: @200 s",
        "star_tracker.off",
        "must be later than on, 234 s",
    ),
    "vibration band inside out": (
        "lowest_frequency: 20 Hz",
        "lowest_frequency: @3 kHz",
        "imu.vibration.lowest_frequency",
        "must be below 200 Hz, half the rate of the IMU",
    ),
    "camera axes": (
        "boresight: [0, 1, 0]",
        "boresight: [1, 1, 0]",
        "star_camera.mounting.image_right",
        "must be at right angles to boresight, is at 45.00 deg",
    ),
    "no direction": (
        "boresight: [0, 1, 0]",
        "boresight: @[0, 0, 0]",
        "star_camera.mounting.boresight",
        "must not be zero",
    ),
    "catalogue deeper than the sky": (
        "faintest: 5.5 mag",
        "faintest: @7.5 mag",
        "star_tracker.catalogue.faintest",
        "the camera draws stars to V 7",
    ),
    "memory of the filter": (
        "history: 0.6 s",
        "history: @80 ms",
        "navigation.history",
        "must be longer than the 85 ms that a star fix is late",
    ),
}


@pytest.mark.parametrize("kind", BROKEN)
def test_one_message_that_names_place_and_field(tmp_path, kind):
    good, bad, field, words, *others = BROKEN[kind]
    text = TEXT
    for lines in others:  # good in themselves, each in the place of the line with its last key
        key = lines.rpartition("\n")[2].partition(":")[0]
        text, n = re.subn(rf"^{key}: .*$", lines, text, count=1, flags=re.M)
        assert n == 1, lines
    check_one_message(tmp_path, good, bad, field, words, text)


def test_all_errors_at_once_in_the_order_of_the_file(tmp_path):
    text = TEXT.replace("rate: 10 Hz", "rate: 10").replace("latency: 0.2 s", "latency: 0.2 m")
    path = tmp_path / "broken.yaml"
    path.write_text(text.replace("history: 0.6 s", "histroy: 0.6 s"), encoding="utf-8")
    fields = [said.split(": ")[1] for said in messages(path)]
    assert fields == ["gps.latency", "star_tracker.rate", "navigation.histroy"]


def test_all_duplicate_keys_at_once(tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text("a: 1\na: 2\nb:\n  c: 1\n  c: 2\n", encoding="utf-8")
    assert [said.split(": ")[1] for said in messages(path)] == ["a", "b.c"]


# --set text: what is said
BAD_OVERRIDES = {
    "star_tracker.rate": "--set star_tracker.rate: expected path=value, "
    "for example --set star_tracker.rate='5 Hz'",
    "=5 Hz": "--set : expected path=value, for example --set star_tracker.rate='5 Hz'",
    "star_tracker.rat=5 Hz": "--set star_tracker.rat: unknown key; did you mean 'rate'?",
    "star_traker.rate=5 Hz": "--set star_traker.rate: star_traker: unknown key; did you mean 'star_tracker'?",
    "star_tracker.rate=5 m": "--set star_tracker.rate: '5 m' is a length, "
    "expected a frequency such as '10 Hz'",
    "gps.rate=1e-9 Hz": "--set gps.rate: 1e-09 Hz does not divide the on-board clock, 100 Hz; "
    "take 1, 2, 4, 5, 10, 20, 25 or 50 Hz",
    "star_tracker.rate=7 Hz": "--set star_tracker.rate: 7 Hz does not divide the on-board clock, 100 Hz; "
    "take 1, 2, 4, 5, 10 or 20 Hz",
    "star_tracker.rate=": "--set star_tracker.rate: expected a quantity such as '10 Hz', got nothing",
    "gps.antenna.lever_arm.3=1 m": "--set gps.antenna.lever_arm.3: gps.antenna.lever_arm is a list, "
    "its items are 0 to 2, got '3'",
    "gps.antenna.lever_arm.x=1 m": "--set gps.antenna.lever_arm.x: gps.antenna.lever_arm is a list, "
    "its items are 0 to 2, got 'x'",
    "gps.antenna.lever_arm.1=1 s": "--set gps.antenna.lever_arm.1: '1 s' is a time, expected a length "
    "such as '0.3 m'",
    "mission.name.first=x": "--set mission.name.first: mission.name is a single value, "
    "there is no 'first' in it",
    "imu=[1": "--set imu: not valid YAML: while parsing a flow sequence, expected ',' or ']', but got "
    "'<stream end>'",
}


@pytest.mark.parametrize("override", BAD_OVERRIDES)
def test_bad_override(override):
    assert the_message(DEFAULT, [override]) == BAD_OVERRIDES[override]


def test_bad_values_of_file_and_command_line_together(tmp_path):
    path = tmp_path / "broken.yaml"
    path.write_text(TEXT.replace("rate: 10 Hz", "rate: 10"), encoding="utf-8")
    said = messages(path, ["gps.latency=1"])
    assert said[0] == "--set gps.latency: 1 has no unit; write it with one, for example '1 s'"
    assert said[1].startswith(f"{path}:")


def test_an_error_in_the_base_names_the_base(tmp_path):
    base, path = tmp_path / "base.yaml", tmp_path / "top.yaml"
    base.write_text(TEXT.replace("rate: 10 Hz", "rate: 10"), encoding="utf-8")
    path.write_text("extends: base.yaml\ngps:\n  latency: 0.2\n", encoding="utf-8")
    in_base, in_top = messages(path)
    line = TEXT[: TEXT.index("rate: 10 Hz")].count("\n") + 1
    assert in_base.startswith(f"{base}:{line}:9: star_tracker.rate: ")
    assert in_top.startswith(f"{path}:3:12: gps.latency: ")


def test_a_cycle_of_three_files(tmp_path):
    for name, base in (("a", "b"), ("b", "c"), ("c", "a")):
        (tmp_path / f"{name}.yaml").write_text(f"extends: {base}.yaml\n", encoding="utf-8")
    said = the_message(tmp_path / "a.yaml")
    assert said.startswith(f"{tmp_path / 'c.yaml'}:1:10: extends: ")
    assert "in a circle" in said
