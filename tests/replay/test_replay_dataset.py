"""Series on one time axis: increments from samples of several kinds, gaps, fixes that are chosen."""

from types import SimpleNamespace

import numpy as np
import pytest
import replay_files

from shefex_nav.geometry import wgs84
from shefex_nav.replay import dataset, load, schema, schema_data
from shefex_nav.replay.series import GnssSeries, ImuSeries, TruthSeries
from shefex_nav.scenario.data_table import DataError, Table
from shefex_nav.scenario.load import ScenarioError


def imu_series(t_s, gyro, kind="rate"):
    """ImuSeries with this rate about x, y, z and no force."""
    lines = np.arange(len(t_s)) + 2
    return ImuSeries(Table("imu.csv", {}, lines), t_s, gyro, np.zeros_like(gyro), kind)


def settings(samples="mean", longest_gap=0.1, rate=100.0, axes=("x", "y", "z")):
    """What dataset.increments wants to know."""
    part = SimpleNamespace(rate=rate)
    return SimpleNamespace(samples=samples, longest_gap=longest_gap, imu=part, axes=axes)


def test_instant_samples_of_a_growing_rate_are_integrated_exactly():
    t_s = np.arange(101) / 100.0
    gyro = np.column_stack([3.0 * t_s, -t_s, 0.5 + 0.0 * t_s])
    out = dataset.increments(imu_series(t_s, gyro), settings("instant"))
    np.testing.assert_allclose(out.dtheta_b.sum(axis=0), [1.5, -0.5, 0.5], atol=1e-13)


def test_mean_samples_are_those_of_the_interval_before():
    t_s = np.arange(101) / 100.0
    means = np.column_stack([3.0 * (t_s - 0.005), -(t_s - 0.005), 0.5 + 0.0 * t_s])
    out = dataset.increments(imu_series(t_s, means), settings())
    np.testing.assert_allclose(out.dtheta_b.sum(axis=0), [1.5, -0.5, 0.5], atol=1e-13)
    np.testing.assert_allclose(np.cumsum(out.dtheta_b[:, 0]), 1.5 * out.t_s**2, atol=1e-13)


@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_a_gap_is_bridged_without_loss_of_angle(kind):
    """Seven samples are missing while the rate grows evenly; their angle is that of the rates around them."""
    t_s = np.delete(np.arange(101) / 100.0, np.arange(40, 47))
    gyro = np.column_stack([2.0 + t_s - 0.005, 0.0 * t_s, 0.0 * t_s])
    values = gyro / 100.0 if kind == "increment" else gyro
    out = dataset.increments(imu_series(t_s, values, kind), settings())
    assert len(out.t_s) == 101 and out.bridged.sum() == 7
    np.testing.assert_allclose(out.t_s, np.arange(101) / 100.0, atol=1e-12)
    assert out.dtheta_b[:, 0].sum() == pytest.approx(2.5, abs=1e-9)


def test_uneven_samples_keep_their_own_length():
    rng = np.random.default_rng(5)
    t_s = np.arange(201) / 100.0 + 1e-3 * rng.uniform(-1.0, 1.0, 201)
    out = dataset.increments(imu_series(t_s, np.ones((201, 3))), settings())
    assert not out.bridged.any()
    np.testing.assert_allclose(np.cumsum(out.dtheta_b[:, 0]), t_s - t_s[0], atol=1e-12)


@pytest.mark.parametrize("late", [{40: 0.0072}, {40: 0.0451, 41: 0.0353, 42: 0.0255, 43: 0.0157, 44: 0.0059}])
@pytest.mark.parametrize("kind", ["rate", "increment"])
def test_rows_that_are_stamped_late_are_no_gap(kind, late):
    """One row, or a file that waits and then writes five at once: all 101 samples are there, and an increment
    is what it is. Bridged, the angle of the increments was 0.7 % and 4.5 % too large."""
    t_s = np.arange(101) / 100.0
    t_s[list(late)] += list(late.values())
    values = np.full((101, 3), 0.01 if kind == "increment" else 1.0)
    imu = imu_series(t_s, values, kind)
    out = dataset.increments(imu, settings())
    assert not out.bridged.any()
    np.testing.assert_allclose(out.dtheta_b.sum(axis=0), 1.0, rtol=1e-12)
    ((field, words),) = dataset.late_rows(imu)
    assert field == "data.imu" and words.startswith("1 of 101 rows come late")


def test_a_row_that_is_missing_beside_uneven_ones_is_bridged():
    """Seed 4: rows off by up to 15 % of a sample, of which two are missing, one of them alone."""
    t_s = np.arange(101) / 100.0 + 1.5e-3 * np.random.default_rng(4).uniform(-1.0, 1.0, 101)
    imu = imu_series(np.delete(t_s, [30, 60, 61]), np.full((98, 3), 0.01), "increment")
    out = dataset.increments(imu, settings())
    assert out.bridged.sum() == 3 and not list(dataset.late_rows(imu))
    np.testing.assert_allclose(out.dtheta_b.sum(axis=0), 1.0, rtol=1e-12)


def test_a_gap_that_is_too_long_is_named():
    t_s = np.delete(np.arange(101) / 100.0, np.arange(40, 60))
    with pytest.raises(DataError, match=r"imu\.csv:42: no sample for 0\.21 s .* allows 0\.1 s"):
        dataset.increments(imu_series(t_s, np.ones((81, 3))), settings())


def test_another_rate_than_stated_is_named():
    with pytest.raises(DataError, match=r"has 100 samples a second, data\.imu\.rate says 200"):
        dataset.increments(imu_series(np.arange(11) / 100.0, np.ones((11, 3))), settings(rate=200.0))


def test_times_that_are_not_those_of_the_samples_are_told_apart_from_another_rate():
    """A logger writes when it got them: two at a time, 200 a second all the same."""
    t_s = (np.arange(1001) + 0.4 * (np.arange(1001) % 2)) / 200.0
    words = r"has 200 samples a second on average, .* but steps of 0\.003 s to 0\.007 s \(median 0\.007 s\)"
    with pytest.raises(DataError, match=words):
        dataset.increments(imu_series(t_s[:-1], np.ones((1000, 3))), settings(rate=200.0))


def test_axes():
    """A sensor with y forward, x right, z up, as surveyors like it."""
    body = dataset.body_axes(np.array([[1.0, 2.0, 3.0]]), ("y", "x", "-z"))
    np.testing.assert_array_equal(body, [[2.0, 1.0, -3.0]])


def gnss_series(t_s):
    """Fixes of one place with sigmas 1, 2, 3 m."""
    n = len(t_s)
    r_e = np.tile(wgs84.ecef_from_geodetic(0.8, 0.2, 100.0), (n, 1))
    sigma = np.tile([1.0, 2.0, 3.0], (n, 1))
    table = Table("gnss.csv", {}, np.arange(n) + 2)
    return GnssSeries(table, t_s, r_e, np.zeros((n, 3)), sigma, None, np.ones(n, dtype=bool))


def chosen(t_s, **given):
    """Times of the fixes that are taken."""
    given = {"velocity_noise": ["0.1 m/s"] * 3} | given
    fixes = dataset.fixes(gnss_series(t_s), schema.ReplayGnss(**given))
    return [fix.t_valid_s for fix in fixes]


def test_one_fix_a_second_of_five():
    t_s = np.arange(21) / 5.0
    assert chosen(t_s) == t_s.tolist()
    assert chosen(t_s, every="1 s") == [0.0, 1.0, 2.0, 3.0, 4.0]
    np.testing.assert_allclose(chosen(t_s, every="1 s", first="0.2 s"), [0.2, 1.2, 2.2, 3.2])


def test_a_fix_that_is_missing_is_not_replaced_by_its_neighbour():
    t_s = np.delete(np.arange(21) / 5.0, [10])
    assert chosen(t_s, every="1 s") == [0.0, 1.0, 3.0, 4.0]


def test_noise_of_fixes_is_turned_into_the_axes_of_the_earth():
    fix = dataset.fixes(gnss_series(np.arange(3.0)), schema.ReplayGnss(velocity_noise=["0.1 m/s"] * 3))[0]
    C_en = wgs84.dcm_en(0.8, 0.2)
    np.testing.assert_allclose(C_en.T @ fix.R_r_e @ C_en, np.diag([1.0, 4.0, 9.0]), atol=1e-12)
    np.testing.assert_allclose(fix.R_v_e, 0.01 * np.eye(3), atol=1e-15)


def test_a_receiver_that_says_nothing_of_its_noise_needs_a_word():
    with pytest.raises(
        DataError, match=r"gnss\.csv: says nothing about the noise of the velocity; give gnss"
    ):
        dataset.fixes(gnss_series(np.arange(3.0)), schema.ReplayGnss())


def small(folder, imu_times, gnss_times, **given):
    """Dataset of small CSVs."""
    rows = [(t, 0.0, 0.0, 0.0, 0.0, 0.0, -9.8) for t in imu_times]
    replay_files.write_csv(folder / "imu.csv", ("t", "wx", "wy", "wz", "fx", "fy", "fz"), rows)
    names = ("t", "lat", "lon", "h", "vn", "ve", "vd")
    fixes = [(t, 48.0, 11.0, 500.0, 0.0, 0.0, 0.0) for t in gnss_times]
    replay_files.write_csv(folder / "gnss.csv", names, fixes)
    columns = (*names, "roll", "pitch", "heading")
    replay_files.write_csv(folder / "truth.csv", columns, [(*fix, 0.0, 0.0, 0.0) for fix in fixes])
    path = replay_files.scenario(folder, replay_files.CSV.format(rate=20), **given)
    return dataset.read(*load.load(path))


def test_time_counts_from_the_first_sample_of_the_imu(tmp_path):
    data = small(tmp_path, np.arange(500.0, 510.0, 0.05), np.arange(501.0, 509.0))
    assert data.imu.t_s[0] == 0.0
    np.testing.assert_allclose([fix.t_valid_s for fix in data.fixes], np.arange(1.0, 9.0))
    np.testing.assert_allclose(data.truth.t_s, np.arange(1.0, 9.0))


def test_clocks_that_have_nothing_in_common_are_noticed(tmp_path):
    with pytest.raises(DataError, match=r"gnss\.csv: covers -500 s to -493 s .* are the clocks the same\?"):
        small(tmp_path, np.arange(500.0, 510.0, 0.05), np.arange(0.0, 8.0))


def test_time_that_runs_back_is_named_with_its_line(tmp_path):
    with pytest.raises(DataError, match=r"gnss\.csv:5: time 501\.5 s does not follow on 503 s"):
        small(tmp_path, np.arange(500.0, 510.0, 0.05), [501.0, 502.0, 503.0, 501.5])


def series_of(counts, unit):
    """ImuSeries of times in a unit, and the section of its columns."""
    columns = schema_data.ImuColumns(
        file="imu.csv", rate="100 Hz", time="t", time_unit=unit, gyro=["a"] * 3, gyro_unit="deg/s",
        accelerometer=["b"] * 3, accelerometer_unit="gee",
    )  # fmt: skip
    n = len(counts)
    table = Table("imu.csv", {"t": np.array(counts, float)}, np.arange(n) + 2)
    return ImuSeries(
        table, table.columns["t"] * columns.time_unit.factor, *np.zeros((2, n, 3)), "rate"
    ), columns


@pytest.mark.parametrize(
    ("span", "unit", "words"),
    [
        (2**32, "ms", "2^32 ms; add 4294967296 ms"),
        (2**32, "us", "2^32 us; add 4294967296 us"),
        (2**32 / 1e6, "s", "2^32 us; add 4294.967296 s"),
        (2**24, "ms", "2^24 ms; add 16777216 ms"),
        (604800, "s", "the end of the week; add 604800 s"),
        (86400000, "ms", "the end of the day; add 86400000 ms"),
    ],
)
def test_a_clock_that_wraps_around_is_told_as_such(span, unit, words):
    step = {"s": 0.01, "ms": 10.0, "us": 1e4}[unit]
    counts = (span - 20.5 * step + step * np.arange(40)) % span
    with pytest.raises(DataError) as caught:
        dataset.check_times(*series_of(counts, unit))
    said = str(caught.value)
    assert said.startswith("imu.csv:23: time ") and f" {unit} does not follow on " in said
    assert said.endswith(f": the clock wraps around at {words} to the times from this line on")


def test_a_clock_that_was_set_back_has_not_wrapped():
    with pytest.raises(DataError) as caught:
        dataset.check_times(*series_of([0, 10, 20, 30, 15, 25], "ms"))
    assert str(caught.value) == "imu.csv:6: time 15 ms does not follow on 30 ms in the row before"


def test_a_reading_that_no_sensor_gives_is_refused_with_its_place():
    series, columns = series_of(10.0 * np.arange(30), "ms")
    told = {
        "bias": "1 deg/h",
        "in_run_bias": "0 deg/h",
        "in_run_bias_time": "300 s",
        "random_walk": "0.1 deg/sqrt(h)",
    }
    pulls = {
        "bias": "1 mgee",
        "in_run_bias": "0 ugee",
        "in_run_bias_time": "300 s",
        "random_walk": "0.1 m/s/sqrt(h)",
    }
    for limit, rate in (("300 deg/s", 590.0), ("unlimited", 1e5)):
        series.gyro[7, 1] = np.radians(rate)
        settings = schema.ReplayImu(gyro=told | {"range": limit}, accelerometer=pulls)
        dataset.check_imu(series, settings, columns)
    for limit, rate, words in (
        (
            "300 deg/s",
            610.0,
            r"610 deg/s is no reading of a sensor whose range is 300 deg/s \(imu.gyro.range",
        ),
        ("unlimited", 1e6, "1e.06 deg/s is no reading of a sensor; check"),
    ):
        series.gyro[7, 1] = np.radians(rate)
        settings = schema.ReplayImu(gyro=told | {"range": limit}, accelerometer=pulls)
        with pytest.raises(DataError, match=rf"imu\.csv:9: a: {words}"):
            dataset.check_imu(series, settings, columns)
    series.gyro[7, 1], series.accelerometer[3, 2] = 0.0, 1e99
    with pytest.raises(DataError, match=r"imu\.csv:5: b: 1e.99 m/s2 is no reading of a sensor"):
        dataset.check_imu(series, settings, columns)
    series.accelerometer[3, 2] = 9e4
    dataset.check_imu(series, settings, columns)
    series.accelerometer[3, 2] = 20_000 * 9.80665
    with pytest.raises(DataError, match=r"imu\.csv:5: b: 1.961e\+05 m/s2 is no reading of a sensor; check"):
        dataset.check_imu(series, settings, columns)


REFUSED = {
    "left-handed": ("data.axes=[x, y, -z]", "data: axes: x, y, -z are left-handed"),
    "twice": ("data.axes=[x, -x, z]", "data: axes: x, -x, z name one axis twice"),
    "format": (
        "data.format=navigo",
        "data: format: 'navigo' is not known; choose from: csv, kf_gins, navego",
    ),
    "a list": ("data.format=[csv]", "data: format: a list is not known; choose from: csv, "),
    "method": ("alignment.method=guess", "alignment: method: 'guess' is not known; choose from: reference, "),
    "unit": ("data.imu.gyro_unit=m/s", "data.imu.gyro_unit: 'm/s' is no unit of these columns"),
    "kinds": ("data.imu.gyro_unit=rad", "data.imu.accelerometer_unit: the gyros give increments"),
    "truth": ("data.truth=null", "alignment.method: 'reference' needs data.truth"),
    "file": ("data.gnss.file=g.csv", "data.gnss.file: there is no file"),
    "states": ("navigation.states=[gyro_scale, gyro_roll_column]", "estimate the same error"),
    "no block": ("navigation.states=[clock]", "navigation.states.0: 'clock' is not known"),
    "bias": ("imu.gyro.bias=1 m", "imu.gyro.bias: '1 m' is a length"),
    "end": ("mission.end=0.5 s", "mission.end: must be at least 1 s after mission.start"),
}


def test_wrong_values_contradictions_and_missing_files_are_told_at_once(tmp_path):
    """What is wrong by itself hides nothing of what does not depend on it."""
    small(tmp_path, np.arange(500.0, 510.0, 0.05), np.arange(501.0, 509.0))
    overrides = {
        "imu.gyro.bias=1 m": "imu.gyro.bias: '1 m' is a length",
        "data.imu.rate=fast": "data.imu.rate: ",
        "mission.end=0.5 s": "mission.end: must be at least 1 s after mission.start",
        "data.imu.gyro_unit=rad": "data.imu.accelerometer_unit: the gyros give increments",
        "data.gnss.file=g.csv": "data.gnss.file: there is no file",
        "data.truth=null": "alignment.method: 'reference' needs data.truth",
        "navigation.states=[gyro_scale, gyro_roll_column]": "estimate the same error",
    }
    with pytest.raises(ScenarioError) as caught:
        load.load(tmp_path / "small.yaml", list(overrides))
    assert len(caught.value.messages) == len(overrides), str(caught.value)
    for words in overrides.values():
        assert words in str(caught.value), words


@pytest.mark.parametrize(
    ("mistake", "silent"),
    [
        ("mission.start=soon", "mission.end=0.5 s"),  # an end can only be too early against a start
        ("data.imu.accelerometer_unit=m", "data.imu.gyro_unit=rad"),
        ("data.format=navigo", "data.gnss.file=g.csv"),
    ],
)
def test_nothing_is_said_of_what_a_wrong_value_contradicts(mistake, silent, tmp_path):
    small(tmp_path, np.arange(500.0, 510.0, 0.05), np.arange(501.0, 509.0))
    with pytest.raises(ScenarioError) as caught:
        load.load(tmp_path / "small.yaml", [mistake, silent])
    assert len(caught.value.messages) == 1, str(caught.value)


@pytest.mark.parametrize("kind", REFUSED)
def test_a_scenario_that_cannot_be_is_refused(kind, tmp_path):
    override, words = REFUSED[kind]
    small(tmp_path, np.arange(500.0, 510.0, 0.05), np.arange(501.0, 509.0))
    with pytest.raises(ScenarioError) as caught:
        load.load(tmp_path / "small.yaml", [override])
    assert len(caught.value.messages) == 1 and words in str(caught.value), str(caught.value)


def test_a_row_of_truth_that_no_vehicle_reaches_is_refused():
    t_s = np.arange(5) * 0.1
    r_e = np.array([[6.4e6, 1e3 * t, 0.0] for t in t_s])
    table = Table("truth.csv", {}, np.arange(2, 7))
    truth = TruthSeries(table, t_s, r_e, np.zeros((5, 3)), np.zeros((5, 3)))
    dataset.check_way(truth)
    near = r_e.copy()
    near[3, 2] = 900.0  # of a survey by hand
    dataset.check_way(truth._replace(r_e=near))
    far = r_e.copy()
    far[3] = [0.0, 6.4e6, 0.0]  # a latitude or a longitude of 0
    with pytest.raises(DataError, match=r"truth\.csv:5: the position is 9\.051e\+06 m from that of the row"):
        dataset.check_way(truth._replace(r_e=far))
