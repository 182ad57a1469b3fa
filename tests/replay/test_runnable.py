"""Logs over which the filter cannot be run again: blocks, readings and alignments that cannot be."""

import numpy as np
import pytest
from flown_log import write

from shefex_nav.log import checked, reader
from shefex_nav.log.topics import LogError
from shefex_nav.records import Alignment
from shefex_nav.replay import rerun


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    return reader.read(write(tmp_path_factory.mktemp("flown") / "run.mcap"))


def refused(data, words):
    with pytest.raises(LogError, match=rf"^a\.mcap: {words}"):
        rerun.check_runnable("a.mcap", data)


def changed(values, k, value):
    values = values.copy()
    values[k] = value
    return values


def test_what_was_flown_can_be_run_again(data):
    rerun.check_runnable("a.mcap", data)


def test_a_block_that_does_not_follow_on_the_one_before_it(data):
    imu = data.imu
    short = imu._replace(dt_s=changed(imu.dt_s, 77, 0.0024))
    words = r"/imu: message 78: t_valid_s: got 0\.78, expected 0\.7796: its 4 samples of 0\.0024 s"
    refused(data._replace(imu=short), words)
    late = imu._replace(t_valid_s=changed(imu.t_valid_s, 77, imu.t_valid_s[77] + 2e-6))
    refused(data._replace(imu=late), r"/imu: message 78: t_valid_s: got 0\.780002, expected 0\.78:")
    rounded = imu._replace(t_valid_s=changed(imu.t_valid_s, 77, imu.t_valid_s[77] + 0.5e-6))
    rerun.check_runnable("a.mcap", data._replace(imu=rounded))


def test_an_alignment_where_no_block_begins(data):
    for t_s in (0.5, 5.0, 0.0003):
        words = (
            rf"/nav/alignment: t_valid_s: got {t_s:g}, expected 0, where the 4 samples of 0\.0025 s of /imu"
        )
        refused(data._replace(alignment=data.alignment._replace(t_valid_s=t_s)), words)
    imu = data.imu._replace(t_valid_s=data.imu.t_valid_s + 0.0003)
    refused(data._replace(imu=imu), r"/nav/alignment: t_valid_s: got 0, expected 0\.0003, where")
    three = data.imu._replace(dtheta_b=data.imu.dtheta_b[:, :3], dv_b=data.imu.dv_b[:, :3])
    refused(data._replace(imu=three), r"/nav/alignment: t_valid_s: got 0, expected 0\.0025, where the 3")


@pytest.mark.parametrize(
    ("name", "most", "unit"),
    [("dtheta_b", 3000.0, "rad/s"), ("dv_b", 1e5, r"m/s\^2")],
    ids=["gyro", "accelerometer"],
)
def test_readings_of_no_sensor(data, name, most, unit):
    """Told as rates: 1e6 m/s within 2.5 ms."""
    values = getattr(data.imu, name)
    good = data.imu._replace(**{name: changed(values, (9, 2, 1), -0.99 * most * 0.0025)})
    rerun.check_runnable("a.mcap", data._replace(imu=good))
    bad = data.imu._replace(**{name: changed(values, (9, 2, 1), -2.0 * most * 0.0025)})
    words = rf"/imu: message 10: {name}: got {2.0 * most:.4g} {unit} over 0\.0025 s, expected {most:g} {unit}"
    refused(data._replace(imu=bad), words.replace("+", r"\+"))
    silent = bad._replace(
        valid=changed(bad.valid, 9, False), **{name: changed(getattr(bad, name), 9, np.nan)}
    )
    rerun.check_runnable("a.mcap", data._replace(imu=silent))


def test_an_alignment_far_from_the_truth(data):
    told = data.alignment
    moon = told._replace(r_i=np.array([4e8, 0.0, 0.0]))
    refused(data._replace(alignment=moon), r"/nav/alignment: r_i: is 3\.\d+e\+08 m from the truth at T\+0\.0")
    vague = told._replace(r_i=told.r_i + np.array([2e6, 0.0, 0.0]), sigma_r=1e6)
    rerun.check_runnable("a.mcap", data._replace(alignment=vague))
    fast = told._replace(v_i=told.v_i + 2e3)
    refused(data._replace(alignment=fast), r"/nav/alignment: v_i: is 3464 m/s from the truth")
    nothing = data.truth._replace(**{name: getattr(data.truth, name)[:0] for name in data.truth._fields})
    rerun.check_runnable("a.mcap", data._replace(alignment=fast, truth=nothing))
    refused(
        data._replace(alignment=moon._replace(r_i=5.0 * moon.r_i), truth=nothing),
        "/nav/alignment: r_i: got 2e",
    )


def test_an_alignment_of_numbers_that_overflow(data):
    for name, value in (
        ("sigma_r", 1e14),
        ("sigma_v", 1e14),
        ("sigma_gyro_bias", 1e9),
        ("gyro_bias", np.full(3, 1e14)),
        ("gyro_bias", np.full(3, np.nan)),
    ):
        told = data.alignment._replace(**{name: value})
        refused(data._replace(alignment=told), rf"/nav/alignment: {name}: got .*, expected .* at most")


def test_an_alignment_at_the_centre_of_the_earth_is_not_read(data):
    centre = data.alignment._replace(r_i=np.zeros(3))
    words = r"message 1: r_i: got 0 m from the centre of the Earth, expected 6\.3e\+06 m at least"
    with pytest.raises(LogError, match=words):
        checked.check("a.mcap", "/nav/alignment", Alignment, [centre])
    checked.check("a.mcap", "/nav/alignment", Alignment, [data.alignment])
    checked.check("a.mcap", "/nav/alignment", Alignment, [])


def test_fixes_with_and_without_a_height(data):
    """The innovations of one sensor would be of three axes, then of two."""
    fixes = list(data.gps)
    fixes[3] = fixes[3]._replace(horizontal=True)
    refused(data._replace(gps=fixes), r"/gps/fix: message 4: horizontal: got True, expected False")
    fixes[3] = fixes[3]._replace(valid=False)
    rerun.check_runnable("a.mcap", data._replace(gps=fixes))
    rerun.check_runnable("a.mcap", data._replace(gps=[fix._replace(horizontal=True) for fix in data.gps]))
