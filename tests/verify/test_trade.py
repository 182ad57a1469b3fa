"""Trades: the same covariances as the bound, errors that scale as they must, shares of Gaussian errors."""

import json
import shlex
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from typer.testing import CliRunner

from shefex_nav import prepare
from shefex_nav.clock import sample_s
from shefex_nav.commands.app import app
from shefex_nav.records import Phase
from shefex_nav.report import sensor_limits
from shefex_nav.scenario import load, sweeps
from shefex_nav.scenario.layers import ScenarioError
from shefex_nav.scenario.requirements import Requirements
from shefex_nav.verify import bound, bound_model, over_bound
from shefex_nav.verify.trade import judge, picture, plan, pointing, predict, stars, table
from shefex_nav.verify.trade.growth import Growth

NIGHT = [  # instruments at rest for 100 s
    "mission.time_limit=100 s",
    "star_tracker.off=100 s",
]
SHORT = [*NIGHT, "star_tracker.enabled=false"]
STATES = "gyro_scale, gyro_misalignment, gyro_g_sensitivity, accel_scale, accel_misalignment, gravity"
BLIND = [*SHORT, "gps.max_pdop=0.001"]  # no fix at all


def predicted(name, overrides, shared=None, **more):
    """Prediction of a scenario, along one flight if `shared` is given."""
    return predict.predict(load.load(name, overrides), shared or predict.Shared(None, 1), **more)


def at_end(prediction):
    """Covariances of the last Errors."""
    return prediction.errors[-1][2:]


def test_a_trade_of_one_combination_is_the_bound():
    """Every fix at its own instant: `bound.follow` gives the same covariances, sample by sample."""
    scenario = load.load("night_sky", SHORT)
    world = prepare.build_world(scenario, 1)
    whole = over_bound.bounds(scenario, world, [])[0]
    found = predict.predict(scenario, predict.Shared(None, 1), gps_s=0.01).errors[-1]
    k = int(np.argmin(np.abs(whole.t_s - found.t_s)))
    assert found.what == predict.END and abs(whole.t_s[k] - found.t_s) < 1e-9
    assert np.linalg.norm(found.position_i) > 0.01  # of something
    for mine, theirs in zip(found[2:], (whole.position_i, whole.velocity_i, whole.attitude_b), strict=True):
        # what differs: intervals of a second and not of half a second, over which sources wander
        assert np.abs(mine - theirs[k]).max() < 1e-4 * np.abs(theirs[k]).max()


def test_an_interval_of_pieces_is_that_of_the_bound():
    scenario = load.load("night_sky", [*SHORT, "imu.gyro.quantum=off", "imu.accelerometer.quantum=off"])
    flight = over_bound.flight_of(scenario, prepare.build_world(scenario, 1), [])
    layout = bound_model.sources(flight.imu, flight.camera, 1e-4, 500.0)
    dt_s = sample_s(flight.trajectory.t_s)
    before, end = 4030, 5270  # within pieces, over several whole ones
    whole = bound._interval(flight, layout, dt_s, before, end)
    joined = Growth(flight).of(flight, layout).interval(before, end)
    assert joined.t_s == whole.t_s
    np.testing.assert_allclose(joined.Phi, whole.Phi, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(joined.Q, whole.Q, rtol=1e-9, atol=1e-9 * np.abs(whole.Q).max())
    assert Growth(flight).of(flight, layout).interval(0, 200).Q[6, 6] > 0.0


def test_fixes_of_other_quanta_are_other_updates():
    """Of one flight: quanta are noise of a fix, which is kept for all that have the same."""
    fix, made, noise = object(), [], {}
    for quantum in (0.1, 5.0, 0.1):
        scenario = load.load("night_sky", [*SHORT, f"imu.gyro.quantum={quantum} arcsec"])
        flight = over_bound.flight_of(scenario, prepare.build_world(scenario, 1), [])
        growth = noise.setdefault("growth", Growth(flight))
        layout = bound_model.sources(flight.imu, flight.camera, 1e-4, 500.0)
        one = growth.of(flight, layout)
        one.update(lambda given, *_: made.append(given.imu.gyro.quantum), 100, fix)
    assert np.degrees(made) * 3600.0 == pytest.approx([0.1, 5.0])


def test_white_noise_adds_to_the_covariance_with_its_square():
    """Nothing is measured: P is linear in the variance of the noise, P(2w) - P(0) = 4 (P(w) - P(0))."""
    shared = predict.Shared(None, 1)
    sizes = {w: at_end(predicted("night_sky", [*BLIND, f"imu.gyro.random_walk={w} deg/sqrt(h)"], shared))
             for w in (0.0, 0.5, 1.0)}  # fmt: skip
    assert predicted("night_sky", BLIND, shared).gps_fixes == 0
    for none, once, twice in zip(sizes[0.0], sizes[0.5], sizes[1.0], strict=True):
        np.testing.assert_allclose(
            twice - none, 4.0 * (once - none), rtol=1e-6, atol=1e-6 * np.abs(twice).max()
        )
    # white noise goes with the square root of the time: 0.5 deg/sqrt(h) over 100 s
    turned = np.degrees(np.sqrt(sizes[0.5][2][0, 0] - sizes[0.0][2][0, 0]))
    assert turned == pytest.approx(0.5 * np.sqrt(100.0 / 3600.0), rel=1e-3)


def test_a_constant_bias_turns_the_attitude_with_the_time():
    """At rest: sigma = bias * t."""
    shared = predict.Shared(None, 1)
    quiet = [*BLIND, "imu.gyro.random_walk=0 deg/sqrt(h)", "imu.gyro.in_run_bias=0 deg/h"]
    none, some = (
        at_end(predicted("night_sky", [*quiet, f"imu.gyro.bias={b} deg/h"], shared))[2][0, 0] for b in (0, 90)
    )
    assert np.degrees(np.sqrt(some - none)) == pytest.approx(90.0 * 100.0 / 3600.0, rel=1e-3)


def test_fixes_taken_together_keep_their_information():
    from shefex_nav.records import GpsFix

    def fix(t_s):
        return GpsFix(t_s, t_s, True, np.zeros(3), np.zeros(3), 4.0 * np.eye(3), np.eye(3), 8, 2.0, "")

    found = predict.together([fix(t) for t in (9.6, 9.8, 10.0, 10.2, 10.4, 11.0)], 1.0)
    assert [one.t_valid_s for one in found] == [10.0, 11.0]
    np.testing.assert_allclose(found[0].R_r_e, 0.8 * np.eye(3))
    np.testing.assert_allclose(found[1].R_v_e, np.eye(3))


def test_shares_of_gaussian_errors():
    for share in (0.5, 0.9, 0.99865, 0.999999):
        for n, variances in ((1, (4.0, 0.0, 0.0)), (2, (4.0, 0.0, 4.0)), (3, (4.0, 4.0, 4.0))):
            wanted = 2.0 * stats.chi(n).ppf(share)
            assert judge.least_limit(judge.length, share, variances) == pytest.approx(wanted, rel=1e-6)
        single = stats.norm.ppf(0.5 + 0.5 * share)
        assert judge.least_limit(judge.axes, share, (1.0, 0.0, 0.0)) == pytest.approx(single, rel=1e-6)
    # unequal variances, against the distribution function of a sum of two: chi-square by convolution
    drawn = np.linalg.norm(np.random.default_rng(1).standard_normal((400_000, 3)) * (3.0, 1.0, 0.2), axis=1)
    share = (drawn <= 5.0).mean()
    error = np.sqrt(share * (1.0 - share) / len(drawn))
    assert abs(judge.length((9.0, 1.0, 0.04), 5.0) - share) < 4.0 * error
    assert judge.axes((1.0, 1.0, 1.0), 2.0) == pytest.approx((2.0 * stats.norm.cdf(2.0) - 1.0) ** 3)


def errors_of(sigma):
    """A prediction whose attitude has a sigma about each axis [rad], a metre and a mm/s otherwise."""
    at = predict.Errors(predict.ENTRY, 400.0, np.eye(3), 1e-6 * np.eye(3), sigma**2 * np.eye(3))
    return predict.Prediction((at,), 10, 100, 90, 1e-5, (), False, ())


def test_a_requirement_is_met_if_the_stated_share_is_within():
    limit = np.radians(0.17)
    required = Requirements.model_validate(
        {"attitude": {"limit": "0.17 deg", "at_entry": True}, "apogee": "9 km"}
    )
    k = stats.norm.ppf(0.5 + 0.5 * 0.99865 ** (1.0 / 3.0))
    for sigma, met in ((0.999 * limit / k, True), (1.001 * limit / k, False)):
        (one,) = judge.judge(required, errors_of(sigma))
        assert (one.name, one.met) == ("attitude_at_entry", met)
        assert one.k == pytest.approx(k, rel=1e-6) and (one.share >= 0.99865) is met
    assert judge.unpredicted(required) == ["apogee"]
    without = errors_of(1e-4)
    without = without._replace(errors=(without.errors[0]._replace(what=predict.END),))
    assert not judge.judge(required, without)[0].met


def test_a_range_that_is_exceeded_before_is_a_doubt():
    imu = load.load("rexus_like", ["imu.gyro.range=100 deg/s"]).imu
    rate = np.zeros((10, 3))
    rate[6] = 2.0
    motion = sensor_limits.Motion(np.arange(10.0), rate, np.zeros((10, 3)))
    assert predict.at_range(imu, motion, 7.0) and not predict.at_range(imu, motion, 5.0)


def study(axes, used, costs):
    """A plan.Study of errors that are given for each combination, in their order."""
    required = Requirements.model_validate({"attitude": {"at_entry": True}})
    whole = []
    for settings, sigma in zip(sweeps.combinations(axes, 10), used, strict=True):
        if sigma is None:
            whole.append(plan.Combination(settings, None, "no such thing", (), None))
            continue
        cost = sum(costs[key][settings[key]] for key in costs)
        prediction = errors_of(sigma)
        judged = tuple(judge.judge(required, prediction))
        whole.append(plan.Combination(settings, prediction, "", judged, cost))
    return plan.ordered("made", required, axes, whole, bool(costs))


def test_the_cheapest_that_meets_all_and_what_has_no_effect(tmp_path):
    axes = (sweeps.Axis("a", ("1", "2", "3")), sweeps.Axis("b", ("x", "y")))
    made = study(axes, (1e-4, 1e-4, 5e-4, 5e-4, 9e-3, None), {"a": {"1": 9.0, "2": 4.0, "3": 1.0}})
    assert [one.settings["a"] for one in made.combinations] == ["1", "1", "2", "2", "3", "3"]
    assert made.cheapest.settings["a"] == "2" and made.idle == ()
    same = study((axes[0], sweeps.Axis("b", ("x", "y"))), (1e-4, 1e-4, 5e-4, 5e-4, 9e-3, 9e-3), {})
    assert same.idle == ("b",) and same.cheapest is None
    asked = plan.Asked("made", axes, costs={"a": {}})
    drawn, lines = table.tables(made, asked)
    assert len(drawn) == 2 and any("* cheapest" in line for line in lines)
    assert any("no prediction: no such thing" in line for line in lines)
    numbers = table.as_numbers(made, asked)
    assert json.dumps(numbers, allow_nan=False) and numbers["combinations"][2]["cheapest"]
    picture.draw(made, asked, tmp_path / "map.png")
    assert (tmp_path / "map.png").stat().st_size > 10_000


def test_entry_and_end_are_never_mixed(tmp_path):
    """One combination ends before its entry, in either order."""
    axes = (sweeps.Axis("a", ("1", "2")),)
    made = study(axes, (1e-4, 5e-4), {"a": {"1": 1.0, "2": 1.0}})
    entry = made.combinations[0].prediction.errors[0]
    end = entry._replace(what=predict.END, attitude_b=9.0 * entry.attitude_b)
    whole, short = (
        one._replace(prediction=one.prediction._replace(errors=errors), judged=())
        for one, errors in zip(made.combinations, ((entry, end), (end,)), strict=True)
    )
    asked = plan.Asked("made", axes, costs={"a": {}})
    for combinations in ((whole, short), (short, whole)):
        both = plan.ordered("made", Requirements(), axes, list(combinations), True)
        drawn, lines = table.tables(both, asked)
        cells = {one.title: list(one.columns[2].cells) for one in drawn[1:]}
        assert sorted(cells["Predicted errors at entry, 1 sigma"])[0] == "-"
        assert len(set(cells["Predicted errors at end, 1 sigma"])) == 1
        assert "So no cheapest is marked." in lines
        picture.draw(both, asked, tmp_path / "map.png")
    assert whole.used == short.used


def test_a_map_of_nothing_is_refused(tmp_path):
    axes = tuple(sweeps.Axis(key, ("1", "2")) for key in "abc")
    made = study(axes, (None, 1e-4) * 4, {})
    with pytest.raises(picture.PictureError, match="nothing is predicted of the combinations with c 1"):
        picture.draw(made, plan.Asked("made", axes), tmp_path / "map.png")
    assert not list(tmp_path.iterdir())


def test_the_command_for_the_corners_can_be_given_to_a_shell():
    axes = tuple(sweeps.Axis(key, ("1 m", "2 m", "3 m")) for key in "abcde")
    words = shlex.split(table.corners(plan.Asked("my flight.yaml", axes, ("f=4 m",), seed=7)))
    assert words[:7] == ["shefex-nav", "campaign", "my flight.yaml", "--runs", "100", "--seed", "7"]
    assert words.count("--sweep") == 4 and "a=1 m,3 m" in words
    assert words[-4:] == ["--set", "e=1 m", "--set", "f=4 m"]


def test_the_campaign_at_the_end_flies_the_marked_unit_too():
    axes = (sweeps.Axis("a", ("1", "2", "3")),)
    made = study(axes, (1e-4, 2e-4, 9e-3), {"a": {"1": 9.0, "2": 4.0, "3": 1.0}})
    lines = table.tables(made, plan.Asked("made", axes, costs={"a": {}}))[1]
    assert made.cheapest.settings == {"a": "2"} and any(line.endswith("--sweep a=1,2,3") for line in lines)


@pytest.mark.parametrize(("second_s", "said"), [(400.0, True), (399.0, False), (None, False)])
def test_a_worst_instant_before_the_second_star_fix_is_told(second_s, said):
    """At an instant with a fix the errors are those just before it. The instant itself is in the table."""
    axes = (sweeps.Axis("a", ("1",)),)
    made = study(axes, (1e-4,), {})
    (one,) = made.combinations
    one = one._replace(prediction=one.prediction._replace(second_star_s=second_s))
    drawn, lines = table.tables(made._replace(combinations=(one,)), plan.Asked("made", axes))
    words = "attitude at entry: at T+400.0 s, before the second star fix"
    assert any(words in line for line in lines) == said
    assert [list(each.columns[-1].cells) for each in drawn[1:]] == [["+400.0"]]


def test_a_fix_that_stands_for_several_frames_is_two():
    fixes = [SimpleNamespace(t_valid_s=t_s) for t_s in (5.0, 6.0)]
    assert stars.StarFixes(fixes, 30, 20, 1e-5).second_s == 5.0
    assert stars.StarFixes(fixes, 3, 2, 1e-5).second_s == 6.0
    assert stars.StarFixes(fixes[:1], 3, 1, 1e-5).second_s is None and stars.NONE.second_s is None


def test_a_doubtful_prediction_is_neither_first_nor_the_cheapest():
    axes = (sweeps.Axis("a", ("1", "2")),)
    made = study(axes, (1e-4, 5e-4), {"a": {"1": 1.0, "2": 4.0}})
    first, second = made.combinations
    doubtful = first._replace(prediction=first.prediction._replace(doubtful=True))
    required = Requirements.model_validate({"attitude": {"at_entry": True}})
    again = plan.ordered("made", required, axes, [doubtful, second], True)
    assert again.combinations[0] is second and again.cheapest is second


def test_costs_are_read_as_sweeps_are():
    assert plan.costs(["imu=stim300:8000,bmi088:20.5", "gps.antenna=[0 m, 1 m]:3"]) == {
        "imu.use": {"stim300": 8000.0, "bmi088": 20.5}, "gps.antenna": {"[0 m, 1 m]": 3.0}
    }  # fmt: skip
    for bad in ("imu", "imu=stim300", "imu=stim300:dear", "imu=:5", "imu=stim300:-1", "imu=stim300:inf"):
        with pytest.raises(plan.TradeError, match="expected KEY=VALUE:COST"):
            plan.costs([bad])
    for bad in (["imu=a:1,a:2"], ["imu=a:1", "imu.use=b:2"]):
        with pytest.raises(plan.TradeError, match="twice"):
            plan.costs(bad)


def test_what_the_linear_model_does_not_know_is_refused():
    with pytest.raises(predict.NoPredictionError, match=r"tight \(it takes fixes"):
        predicted("rexus_like", ["navigation.gps=tight", f"navigation.states=[{STATES}, clock]"])
    with pytest.raises(predict.NoPredictionError, match="names no statistics"):
        predicted("shefex2_andoya", [])
    with pytest.raises(ScenarioError, match=r"nothing\.json"):
        load.star_statistics_of("shefex2_andoya", ["star_tracker.model=nothing.json"])
    assert load.star_statistics_of("shefex2_andoya").format == 3


def test_the_command_ranks_and_is_refused(tmp_path):
    def run(*arguments):
        return CliRunner().invoke(app, ["trade", "night_sky", *arguments])

    drawn = tmp_path / "map.png"
    sets = (*(word for one in SHORT for word in ("--set", one)), "--json", "--workers", "1")
    done = run("--sweep", "imu.gyro.bias=9 deg/h,90 deg/h", *sets, "--figure", str(drawn))
    assert done.exit_code == 0 and drawn.exists()
    found = json.loads(done.stdout)["combinations"]
    assert [one["settings"]["imu.gyro.bias"] for one in found] == ["9 deg/h", "90 deg/h"]
    first, second = (one["errors"]["end"]["attitude_axes_deg"][0] for one in found)
    assert 0.0 < first < second
    bad = run("--sweep", "imu.gyro.bias=9 deg/h,much", *sets)
    assert bad.exit_code == 2 and "--sweep imu.gyro.bias=much: " in bad.stderr
    kept = drawn.read_bytes()
    again = run("--sweep", "imu.gyro.bias=9 deg/h,90 deg/h", *sets, "--figure", str(drawn))
    assert again.exit_code == 2 and drawn.read_bytes() == kept
    again = run("--sweep", "imu.gyro.bias=9 deg/h,9 deg/s", *sets, "--figure", str(drawn), "--force")
    assert again.exit_code == 0 and drawn.read_bytes() != kept
    costly = run("--sweep", "gps.rate=1 Hz,5 Hz", "--cost", "imu=stim300:1", *sets)
    assert costly.exit_code == 2 and "is not tried" in costly.stderr
    judged = run("--sweep", "requirements.probability=95 %,99 %", *sets)
    assert judged.exit_code == 2 and "judged by one requirement" in judged.stderr


def test_an_attitude_that_is_hardly_known_is_a_doubt():
    """At rest over 100 s, sigma = bias * t: 4.5 and 5.5 deg at the end, where 5 is the border."""
    shared = predict.Shared(None, 1)
    for bias, doubtful in ((0.045, False), (0.055, True)):
        assert predicted("night_sky", [*BLIND, f"imu.gyro.bias={bias} deg/s"], shared).doubtful is doubtful


@pytest.mark.parametrize("states", ["automatic", "[gravity]"])
@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("night_sky", ["mission.time_limit=200 s", "star_tracker.off=200 s"]),
        pytest.param("rexus_like", [], marks=pytest.mark.slow),
    ],
)
def test_it_warns_of_what_check_warns(name, more, states):
    """A sweep of the IMU, whose ranges and lasting errors differ; states by name, and left to the program."""
    sets = [f"navigation.states={states}", "star_tracker.enabled=false", *more]
    units = "stim300", "mpu_6050"
    found = plan.work(name, tuple(sets), 1, None, list(enumerate({"imu.use": unit} for unit in units)))
    texts = {k: result[0].warnings for k, result in found}
    for k, unit in enumerate(units):
        words = [word for one in (*sets, f"imu.use={unit}") for word in ("--set", one)]
        told = CliRunner().invoke(app, ["check", name, *words]).stderr.splitlines()
        said = [line for line in told if line.startswith("warning: ")]
        assert len(said) == len(texts[k])
        for line, text in zip(said, texts[k], strict=True):
            assert text.partition(": ")[2] in line and text.partition(": ")[0] in line
    assert any("navigation.states" in text for text in texts[1]) is (states != "automatic")


def test_a_warning_about_an_item_of_a_list_is_one():
    """It ended in a traceback: the place of the item is a number."""
    span = "gps.only=[{from: 300 s, until: 310 s, satellites: 2}]"
    brief = ["mission.time_limit=200 s", "star_tracker.off=200 s", "star_tracker.enabled=false"]
    (text,) = predicted("night_sky", [*brief, span]).warnings
    assert text.startswith("gps.only.0.from: 300 s is after the end of the flight, T+200.0 s")


def test_the_largest_error_between_star_fixes():
    """A fix every 20 s, between them white noise of the gyros: sigma = N sqrt(20 s), far above that of a fix.

    Not before the first fix, where the attitude is known to a degree, and not the less just after one.
    """
    quiet = [f"imu.gyro.{name}=0 deg/h" for name in ("bias", "in_run_bias")]
    quiet += ["star_camera.mounting.error=0 deg", "imu.gyro.random_walk=1 deg/sqrt(h)"]
    sets = [*NIGHT, *quiet, "gps.max_pdop=0.001"]
    shared = predict.Shared(load.star_statistics_of("night_sky", sets), 1)
    found = predicted("night_sky", sets, shared, star_s=20.0)
    assert found.star_fixes > 0
    largest = found.at(predict.STARS)
    sigmas = np.degrees(np.sqrt(np.linalg.eigvalsh(largest.attitude_b)))
    assert sigmas[:2] == pytest.approx(np.sqrt(20.0 / 3600.0), rel=0.02)
    numbers = table.as_numbers(*of_one(found))["combinations"][0]["errors"]
    assert numbers["stars"]["t_s"] == largest.t_s and list(numbers) == ["stars", "end"]
    titles = [one.title for one in table.tables(*of_one(found))[0]]
    assert titles[1:] == [f"{table.TITLES[what]}, 1 sigma" for what in (predict.STARS, predict.END)]
    assert predicted("night_sky", SHORT).at(predict.STARS) is None


def test_the_largest_of_many_instants_is_that_of_so_many_independent_ones():
    """Noise anew at each of 50 instants, or constant errors: the limits are those of 150 angles, or of 3."""
    rng, sigma, m, n = np.random.default_rng(7), 1e-4, 50, 4000
    P = predict.Errors(predict.POINTING, 300.0, np.eye(3), np.eye(3), sigma**2 * np.eye(3))
    required = Requirements.model_validate({"attitude": {"limit": "0.05 deg", "while_pointing": True}})
    for angles, independent in ((rng.standard_normal((n, m, 3)), m), (rng.standard_normal((n, 1, 3)), 1)):
        drawn = sigma * np.abs(angles).max(axis=(1, 2))
        largest = pointing.Largest(m, drawn, drawn, drawn)
        prediction = errors_of(sigma)._replace(largest=(P,), while_pointing=largest)
        (one,) = judge.judge(required, prediction)
        k = stats.norm.ppf(0.5 + 0.5 * 0.99865 ** (1.0 / (3 * independent)))
        assert one.k == pytest.approx(k, rel=0.01) and one.name == "attitude_while_pointing"
        share = (2.0 * stats.norm.cdf(np.radians(0.05) / sigma) - 1.0) ** (3 * independent)
        assert one.share == pytest.approx(share, abs=1e-6)
    assert judge.unpredicted(required) == []
    never = judge.judge(required, errors_of(sigma))[0]
    assert never.found is None and not never.met
    drawn, _ = table.tables(*of_one(prediction, required))
    assert list(drawn[0].columns)[1].header == "a" and "attitude while" in list(drawn[0].columns)[2].header
    assert table.TITLES[predict.POINTING] in drawn[1].title


def test_errors_are_predicted_in_the_phases_pointing():
    class Flown:
        """What is asked of a trajectory: two stretches of pointing."""

        t_s = np.arange(1001) / 100.0
        phase = np.where((t_s > 3.2) & (t_s < 5.7) | (t_s > 8.99), Phase.POINTING, Phase.COAST)

    k = pointing.samples(Flown, 0.5)
    assert [Flown.t_s[one] for one in k] == [3.5, 4.0, 4.5, 5.0, 5.5, 9.0, 9.5, 10.0]


@pytest.mark.slow
def test_errors_while_pointing_are_larger_than_those_of_the_worst_instant():
    """The noise of GPS is another one after a while; the error of the camera's mounting stays."""
    wanted = {name: {"while_pointing": True} for name in ("position", "attitude")}
    sets = [f"requirements.{name}.while_pointing=true" for name in wanted]
    scenario = load.load("shefex2_andoya", [*sets, "requirements.probability=50 %"])
    shared = predict.Shared(load.star_statistics_of("shefex2_andoya", sets), 1)
    found = predict.predict(scenario, shared)
    judged = {one.name: one for one in judge.judge(scenario.requirements, found)}
    position, attitude = (judged[f"{name}_while_pointing"] for name in wanted)
    at_once = {
        name: judge.least_limit(probability, 0.5, values(getattr(found.at(predict.POINTING), field)))
        for name, (field, probability), values in (
            ("position", judge.FIELDS["position"], np.linalg.eigvalsh),
            ("attitude", judge.FIELDS["attitude"], np.diag),
        )
    }
    assert 1.2 < position.found / at_once["position"] < 1.8
    assert 1.0 <= np.radians(attitude.found) / at_once["attitude"] < position.found / at_once["position"]
    assert 250.0 <= found.at(predict.POINTING).t_s <= 372.0
    assert predict.predict(load.load("shefex2_andoya"), shared).at(predict.POINTING) is None


def test_combinations_with_the_same_stars_come_one_after_the_other():
    axes = (
        sweeps.Axis("imu.use", ("i", "j")),
        sweeps.Axis("star_tracker.off", ("1 s", "2 s")),
        sweeps.Axis("launch.elevation", ("80 deg", "81 deg")),
        sweeps.Axis("gps.rate", ("1 Hz", "2 Hz")),
    )
    chosen = sweeps.combinations(axes, 100)
    ordered = plan.in_order(axes, chosen)
    assert sorted(k for k, _ in ordered) == list(range(16)) and all(chosen[k] == one for k, one in ordered)
    flights = [one["launch.elevation"] for _, one in ordered]
    fixes = [(one["star_tracker.off"], one["gps.rate"]) for _, one in ordered[:8]]
    assert flights == ["80 deg"] * 8 + ["81 deg"] * 8 and fixes[::2] == fixes[1::2]
    assert len(set(fixes)) == 4


def of_one(prediction, required=None):
    """plan.Study and plan.Asked of one prediction."""
    axes = (sweeps.Axis("a", ("1", "2")),)
    required = required or Requirements()
    judged = tuple(judge.judge(required, prediction))
    one = plan.Combination({"a": "1"}, prediction, "", judged, None)
    return plan.ordered("made", required, axes, [one], False), plan.Asked("made", axes)
