"""The section gps: what may be given, what is refused, an almanac in place of the nominal satellites."""

import numpy as np
import pytest
from broken import DEFAULT, TEXT, check_one_message, messages, the_message

from shefex_nav import prepare
from shefex_nav.environment import gnss, yuma
from shefex_nav.scenario import params_onboard
from shefex_nav.scenario.load import load
from shefex_nav.scenario.of_settings import settings

YUMA = """******** Week {week} almanac for PRN-{prn:02d} ********
ID:                         {prn:02d}
Health:                     000
Eccentricity:               0.1102590561E-001
Time of Applicability(s):  319488.0000
Orbital Inclination(rad):   0.9847221889
Rate of Right Ascen(r/s):  -0.7737465154E-008
SQRT(A)  (m 1/2):           5153.642090
Right Ascen at Week(rad):   0.2345197091E+001
Argument of Perigee(rad):   0.863190763
Mean Anom(rad):             0.1332284785E+001
Af0(s):                     0.6494522095E-003
Af1(s/s):                  -0.1091393642E-010
week:                        {week}
"""


def almanac(folder, *prns, week=669):
    path = folder / "sky.alm"
    path.write_text("\n".join(YUMA.format(prn=prn, week=week) for prn in prns), encoding="utf-8")
    return path


def scenario(folder, gps):
    path = folder / "own.yaml"
    path.write_text(f"extends: {DEFAULT}\ngps:\n{gps}", encoding="utf-8")
    return path


def test_default_has_nominal_satellites_and_errors_that_do_not_last():
    default = load(DEFAULT)
    receiver = settings(default.gps)
    assert (bool(receiver.errors), receiver.only, receiver.reacquisition) == (False, (), None)
    nominal = gnss.nominal_24("2012-06-22T19:18:00Z")
    np.testing.assert_array_equal(prepare.constellation(default).node, nominal.node)
    nav = params_onboard.nav_params(default)
    assert (nav.gps, nav.range_bias_sigma) == ("loose", 0.0)
    assert nav.clock_white**2 == pytest.approx(0.5 * 299792458.0**2 * 2e-19)
    assert nav.clock_walk**2 == pytest.approx(2.0 * np.pi**2 * 299792458.0**2 * 2e-20)


def test_almanac_in_a_file_beside_the_scenario_is_the_constellation(tmp_path):
    almanac(tmp_path, 7, 3)
    loaded = load(scenario(tmp_path, "  almanac: sky.alm\n"))
    got = prepare.constellation(loaded)
    expected = yuma.constellation(yuma.read(almanac(tmp_path, 3, 7).read_text()), "2012-06-22T19:18:00Z")
    assert got.prn.tolist() == [3, 7]
    for a, b in zip(got, expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-14)
    # the text that a log keeps needs no file
    copy = tmp_path / "kept.yaml"
    copy.write_text(loaded.source, encoding="utf-8")
    (tmp_path / "sky.alm").unlink()
    np.testing.assert_array_equal(prepare.constellation(load(copy)).latitude, got.latitude)


def test_almanac_on_the_command_line(tmp_path):
    path = almanac(tmp_path, 3)
    assert load(DEFAULT, [f"gps.almanac={path}"]).gps.almanac.prn == [3]


def test_errors_in_an_almanac_name_its_line(tmp_path):
    path = almanac(tmp_path, 3, 7)
    path.write_text(path.read_text().replace("5153.642090", "many", 1), encoding="utf-8")
    own = scenario(tmp_path, "  almanac: sky.alm\n")
    assert the_message(own).startswith(
        f"{path}:8:29: SQRT(A) (m 1/2): expected a number such as 12.5, got 'many'"
    )
    path.write_text("hello\n", encoding="utf-8")
    assert any("sky.alm:1:1: expected a line such as" in line for line in messages(own))
    path.unlink()
    assert f"{own}:3:12: gps.almanac: '{path}' there is no such file" in the_message(own)
    assert "expected the name of a YUMA file, got 5" in the_message(scenario(tmp_path, "  almanac: 5\n"))


def test_an_almanac_must_be_of_the_time_of_the_mission(tmp_path):
    almanac(tmp_path, 3, week=600)
    said = the_message(scenario(tmp_path, "  almanac: sky.alm\n"))
    assert "gps.almanac: the almanac is of 485 days before the mission's epoch" in said
    almanac(tmp_path, 3, week=700)
    assert "days after the mission's epoch" in the_message(scenario(tmp_path, "  almanac: sky.alm\n"))


BROKEN = {
    "end before begin": (
        "only: [{from: 20 s, until: @10 s, satellites: 2}]", "gps.only.0.until", "is not after from, 20 s",
    ),
    "how many and which": (
        "only: [@{from: 10 s, until: 20 s, satellites: 2, prn: [3]}]", "gps.only.0", "give one of satellites",
    ),
    "neither": ("only: [@{from: 10 s, until: 20 s}]", "gps.only.0", "give one of satellites"),
    "no such satellite": (
        "only: [{from: 10 s, until: 20 s, prn: [3, @25]}]", "gps.only.0.prn.1", "there is no satellite 25",
    ),
    "shortest and longest": (
        "reacquisition: {shortest: @9 s, longest: 2 s}", "gps.reacquisition.shortest",
        "9 s is longer than longest, 2 s",
    ),
    "more than all is left": (
        "errors: {troposphere: {residual: @120 %}}", "gps.errors.troposphere.residual", "at most 100 %",
    ),
    "three coefficients": (
        "errors: {ionosphere: {alpha: @[1, 2, 3], beta: [1, 2, 3, 4], residual: 10 %}}",
        "gps.errors.ionosphere.alpha", "expected a list of 4 values, got 3 values",
    ),
    "a rate within no range": (
        "errors: {satellite: {rate: @1 mm/s}}", "gps.errors.satellite.rate",
        "swing with this rate within range",
    ),
    "clock without a unit": ("clock: {bias: @5}", "gps.clock.bias", "has no unit"),
}  # fmt: skip


@pytest.mark.parametrize(("bad", "field", "words"), BROKEN.values(), ids=BROKEN.keys())
def test_what_is_refused(tmp_path, bad, field, words):
    check_one_message(tmp_path, "  latency: 0.2 s\n", f"  latency: 0.2 s\n  {bad}\n", field, words, TEXT)


def test_ranges_need_the_clock():
    said = the_message(DEFAULT, ["navigation.gps=tight"])
    states = "gyro_roll_column, accel_scale, accel_rectification, gravity, mounting, clock"
    words = f"gps: tight needs the clock of the receiver; write [{states}]"
    assert said.endswith(f"navigation.states: {words}")
    assert load(DEFAULT, ["navigation.gps=tight", "navigation.states=[mounting, clock]"])
