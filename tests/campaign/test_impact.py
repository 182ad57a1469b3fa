"""Where a rocket lands: against flying on, statistics of drawn normals, and what the files say back."""

import json
import math
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy import stats

from shefex_nav.campaign import running
from shefex_nav.campaign.impact import aim, ellipses, landing, outputs, scatter, studying
from shefex_nav.commands.app import main
from shefex_nav.geometry import wgs84
from shefex_nav.report import track
from shefex_nav.scenario import load

ROCKET = """
extends: rexus_like
mission: {name: rexus_impact, description: Where it lands}
vehicle:
  stages:
    Orion:
      spent: {area: 0.0995 m2, mach: [0, 0.8, 1.1, 2, 4], drag: [4.0, 4.5, 6.0, 5.0, 4.5]}
dispersions:
  launch.elevation: {normal: 0.2 deg}
  vehicle.stages.Orion.motor.thrust_factor: {normal: 1 %}
"""
NO_AIR = ["atmosphere.density=1e-9 %", "wind=none", "vehicle.parachute=null", "gps.outages=[]"]
NO_AIR += ["vehicle.yo_yo=null"]  # what is not spun up would unwind it for minutes
KML = "{http://www.opengis.net/kml/2.2}"


@pytest.fixture(scope="module")
def rocket(tmp_path_factory):
    path = tmp_path_factory.mktemp("rocket") / "rocket.yaml"
    path.write_text(ROCKET)
    return str(path)


@pytest.fixture(scope="module")
def result(rocket):
    return studying.study(studying.Asked(rocket, (), (), None, 6, 1, 1, None, None))


def apart(one, other):
    """Metres between two places, rad."""
    return track.ground_distance(*one, *other)


def place(one):
    return one.latitude, one.longitude


def test_without_air_the_impact_point_is_where_it_lands(rocket):
    """Burnt out, it lands where the vacuum point has been all the time; drag without air changes nothing."""
    scenario = load.load(rocket, NO_AIR)
    landed = landing.land(scenario, 1, 0.0)
    points = landing.impact_points(scenario, landed, 0.0)
    coasting = (points.t_s > 26.0) & (points.t_s < 75.0)
    assert coasting.sum() >= 4
    stage = landed.landings[1]
    for there in points.vacuum[coasting]:  # of the whole; payload and stage part with 4 m/s
        assert apart(there, points.vacuum[coasting][0]) < 1.0
    after = points.vacuum[points.t_s > 77.0]
    for there in after:
        assert apart(there, place(landed.landings[0])) < 5.0  # the IMU, which turns about the centre of mass
    np.testing.assert_allclose(points.vacuum, points.drag, atol=1e-9)
    assert apart(place(stage), points.vacuum[coasting][0]) < 1500.0


def test_impact_points_run_away_from_the_launcher_while_the_motor_burns(rocket):
    scenario = load.load(rocket)
    landed = landing.land(scenario, 1, 360.0)
    points = landing.impact_points(scenario, landed, 360.0)
    site = scenario.launch.latitude, scenario.launch.longitude
    burning = points.t_s < 25.0
    far = [apart(site, there) for there in points.vacuum[burning]]
    assert np.all(np.diff(far) > 0.0) and far[0] < 100.0
    held = [apart(site, there) for there in points.drag[burning]]
    assert np.mean(np.array(held) < np.array(far)) > 0.8


@pytest.mark.parametrize("ground", [-300.0, 0.0, 700.0])
def test_it_lands_on_the_ground_that_is_told(rocket, ground):
    """The last points of the paths; later the lower it lies."""
    landed = landing.land(load.load(rocket), 1, ground)
    way = landed.paths[1]
    assert wgs84.geodetic_from_ecef(way.r_e[-1])[2] == pytest.approx(ground, abs=1e-6)
    higher = landing.land(load.load(rocket), 1, ground + 50.0, paths=False)
    for one, other in zip(landed.landings, higher.landings, strict=True):
        sinking = one.speed * math.sin(one.angle)
        assert one.t_s - other.t_s == pytest.approx(50.0 / sinking, rel=0.1)


def test_the_last_landing_is_the_simulators(rocket):
    landed = landing.land(load.load(rocket), 1, 0.0)
    end = next(event.t_s for event in landed.flight.events if event.name == "impact")
    assert landed.landings[0].t_s == pytest.approx(end, abs=1e-4)


def test_a_stage_without_drag_is_named_and_not_followed():
    landed = landing.land(load.load("rexus_like", ["vehicle.stages.Orion.spent=null"]), 1, 0.0)
    assert landed.unknown == ("Orion",) and [one.body for one in landed.landings] == ["payload"]


def test_parts_that_no_rocket_has_are_warned_of(monkeypatch, capsys):
    words = ["impact", "rexus_like", "--set", "vehicle.imu=[40 m, 0 m, 0 m]", "--json"]
    monkeypatch.setattr("sys.argv", ["shefex-nav", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0
    assert "warning: --set vehicle.imu: the IMU is 40 m ahead of the nose tip" in capsys.readouterr().err


def test_only_what_is_launched_lands():
    with pytest.raises(landing.ImpactError, match="no section launch"):
        landing.check(load.load("orbit"), 0.0)


# ---- statistics ------------------------------------------------------------------------------------------

TRUE_AXES, TRUE_AZIMUTH = (3000.0, 800.0), math.radians(155.0)


def drawn(n, seed=4):
    """Places (2, n) rad of a normal distribution about 68 N 21 E."""
    along, across = np.random.default_rng(seed).standard_normal((2, n)) * np.array(TRUE_AXES)[:, None]
    c, s = math.cos(TRUE_AZIMUTH), math.sin(TRUE_AZIMUTH)
    level = np.column_stack([c * along - s * across, s * along + c * across, np.zeros(n)])
    centre = math.radians(68.0), math.radians(21.0)
    r_e = wgs84.ecef_from_geodetic(*centre, 0.0) + level @ wgs84.dcm_en(*centre).T
    return np.array([wgs84.geodetic_from_ecef(r)[:2] for r in r_e]).T


def test_ellipses_hold_their_share_of_drawn_normals():
    """Of 4000: counts within three standard deviations, axes within three of theirs, 1/sqrt(2 n)."""
    n = 4000
    one = ellipses.ellipse("body", *drawn(n))
    for inside, share in zip(one.inside, (0.3935, 0.8647, 0.9889), strict=True):
        assert abs(inside - n * share) < 3.0 * math.sqrt(n * share * (1.0 - share))
    np.testing.assert_allclose(one.axes, TRUE_AXES, rtol=3.0 / math.sqrt(2.0 * n))
    assert one.azimuth == pytest.approx(TRUE_AZIMUTH, abs=0.02)
    off = apart(place(one), (math.radians(68.0), math.radians(21.0)))
    assert off < 3.5 * math.hypot(*one.error)
    assert one.error[0] == pytest.approx(np.std(one.offsets[:, 0]) / math.sqrt(n), rel=1e-3)


@pytest.mark.parametrize("n", [3, 8, 30])
def test_ellipses_of_few_landings_say_how_often_they_hold_the_next(n):
    """4000 studies: 3 sigma of three landings hold the next one in 52 %, not in 98.9 %."""
    rng, held, tries = np.random.default_rng(8), np.zeros(3, int), 4000
    for _ in range(tries):
        *some, following = rng.standard_normal((n + 1, 2)) @ np.array([[5.0, 2.0], [0.0, 1.0]])
        off = following - np.mean(some, axis=0)
        square = off @ np.linalg.solve(np.cov(np.transpose(some)), off)
        held += square <= np.square(ellipses.SIGMAS)
    for k, count in zip(ellipses.SIGMAS, held, strict=True):
        assert stats.binomtest(int(count), tries, ellipses.share(k, n)).pvalue > 1e-3
        of_f = stats.f.cdf(k**2 * n * (n - 2) / (2.0 * (n**2 - 1)), 2, n - 2)
        assert ellipses.share(k, n) == pytest.approx(of_f)


def test_the_centre_lies_within_its_standard_error():
    """100 samples of 30: the normalised square of the miss has the mean 2 of two dimensions."""
    true = wgs84.ecef_from_geodetic(math.radians(68.0), math.radians(21.0), 0.0)
    squares = []
    for seed in range(100):
        one = ellipses.ellipse("body", *drawn(30, seed))
        off = wgs84.dcm_en(*place(one)).T @ (true - wgs84.ecef_from_geodetic(*place(one), 0.0))
        squares.append(off[:2] @ np.linalg.solve(np.cov(one.offsets.T) / 30.0, off[:2]))
    assert np.mean(squares) == pytest.approx(2.0 * 29.0 / 27.0, abs=3.0 * 2.2 / 10.0)


def test_semi_axes_scatter_by_their_standard_error():
    """200 samples of 30, the longer axis: within 3.5 of the scatter's own standard errors of 5 %."""
    drawn_axes = [ellipses.ellipse("body", *drawn(30, seed)) for seed in range(200)]
    scatter = np.std([one.axes[0] for one in drawn_axes]) / TRUE_AXES[0]
    assert scatter == pytest.approx(drawn_axes[0].axes_error, rel=3.5 * 0.05)


def test_an_outline_is_so_many_sigma_from_the_centre():
    one = ellipses.ellipse("body", *drawn(50))
    inverse = np.linalg.inv(np.cov(one.offsets.T))
    centre, C_en = wgs84.ecef_from_geodetic(*place(one), 0.0), wgs84.dcm_en(*place(one))
    for sigmas in ellipses.SIGMAS:
        r_e = [wgs84.ecef_from_geodetic(*there, 0.0) for there in one.outline(sigmas)]
        level = ((np.array(r_e) - centre) @ C_en)[:, :2]
        distance = np.sqrt(np.einsum("ij,jk,ik->i", level, inverse, level))
        np.testing.assert_allclose(distance, sigmas, rtol=1e-4)


def test_two_landings_have_no_ellipse():
    assert ellipses.ellipse("body", *drawn(2)) is None


def test_runs_draw_what_a_campaign_draws(rocket, result):
    """Run 4 by hand, from the campaign's own sampler."""
    scenario = load.load(rocket)
    plan, sampler = running.prepared(scenario, 6, 1)
    job = sampler.job(4)
    own = landing.land(load.Pattern(plan.source, plan.name).with_draws(job.draws), job.seed, 360.0)
    for one in own.landings:
        np.testing.assert_array_equal(result.scattered.landings[one.body][4], place(one))


@pytest.mark.slow
def test_landings_are_the_same_for_any_number_of_workers(rocket, result):
    cases = [scatter.Case("", load.load(rocket))]
    found = scatter.scatter(cases, 6, 1, 360.0, 2)
    for body, places in result.scattered.landings.items():
        np.testing.assert_array_equal(found.landings[body], places)


def test_runs_without_dispersions_are_refused():
    with pytest.raises(landing.ImpactError, match="no section dispersions"):
        scatter.scatter([scatter.Case("", load.load("rexus_like"))], 3, 1, 0.0, 1)


# ---- aiming, files, command ------------------------------------------------------------------------------


def test_the_launcher_is_set_for_a_wished_impact(rocket):
    """In wind: flown with the setting that was found, the stage lands there."""
    scenario, wished = load.load(rocket), (math.radians(68.08), math.radians(20.6))
    found = aim.aim(scenario, *wished, 1, 360.0, "Orion")
    told = [f"launch.azimuth={math.degrees(found.azimuth)!r} deg"]
    told += [f"launch.elevation={math.degrees(found.elevation)!r} deg"]
    stage = landing.land(load.load(rocket, told), 1, 360.0).landings[1]
    assert apart(place(stage), wished) == pytest.approx(found.miss, abs=0.1)
    assert found.miss < 5.0 and found.flights < 12


@pytest.mark.slow
def test_a_place_out_of_range_is_refused(rocket):
    with pytest.raises(landing.ImpactError, match="no setting of the launcher"):
        aim.aim(load.load(rocket), math.radians(72.0), math.radians(30.0), 1, 360.0, "Orion")


def test_what_is_not_followed_cannot_be_aimed(rocket):
    with pytest.raises(landing.ImpactError, match="payload, Orion"):
        aim.aim(load.load(rocket), 1.18, 0.36, 1, 360.0, "S44")


def test_maps_say_back_what_was_found(result):
    found = outputs.summary(result)
    features = json.loads(outputs.geojson(result))["features"]
    points = {f["properties"]["name"]: f for f in features if f["geometry"]["type"] == "Point"}
    for one in found["cases"][0]["landings"]:
        at = points[one["body"]]["geometry"]["coordinates"]
        assert at == pytest.approx([one["longitude_deg"], one["latitude_deg"], 360.0], abs=1e-7)
    rings = {
        f["properties"]["name"]: f["geometry"]["coordinates"]
        for f in features
        if "sigma" in f["properties"]["name"]
    }
    assert len(rings) == 6 and all(ring[0] == pytest.approx(ring[-1]) for ring in rings.values())
    tree = ElementTree.fromstring(outputs.kml(result))
    marks = {mark.find(f"{KML}name").text: mark for mark in tree.iter(f"{KML}Placemark")}
    styles = {style.get("id") for style in tree.iter(f"{KML}Style")}
    assert {
        m.find(f"{KML}styleUrl").text[1:] for m in marks.values() if m.find(f"{KML}LineString") is not None
    } <= styles
    for name, ring in rings.items():
        text = marks[name].find(f"{KML}LineString/{KML}coordinates").text
        read = [tuple(map(float, point.split(","))) for point in text.split()]
        np.testing.assert_allclose(read, ring, atol=1e-7)
    assert {"launcher", "payload", "Orion", "path of Orion", "impact points, vacuum"} <= marks.keys()


def test_command_writes_what_it_says(rocket, tmp_path, monkeypatch, capsys):
    def command(*words):
        monkeypatch.setattr("sys.argv", ["shefex-nav", "impact", rocket, *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, capsys.readouterr()

    folder = tmp_path / "out"
    code, said = command("--runs", 4, "--output", folder)
    assert code == 0 and "standard error" in said.out and "holds 21.1 % of a normal" in said.out
    found = json.loads((folder / "impact.json").read_text())
    landings = json.loads((folder / "landings.json").read_text())["landings"]["Orion"]
    assert [one["run"] for one in landings] == [0, 1, 2, 3]
    assert found["ground_m"] == 360.0 and found["ellipses"][1]["levels"][2]["sigma"] == 3
    assert (folder / "map.png").read_bytes()[:4] == (folder / "landings.png").read_bytes()[:4] == b"\x89PNG"
    assert command("--output", folder)[0] == 2
    assert command("--aim", "north")[0] == 2 and command("--aim-body", "Orion")[0] == 2
    assert command("--ground", "360")[0] == 2


def test_a_wind_of_the_day_takes_the_place_of_the_scenarios(rocket, tmp_path):
    day = tmp_path / "sounding.csv"
    day.write_text("height_m,wind direction_degree,wind speed_m/s\n0,90,20\n30000,90,20\n")
    calm = studying.study(studying.Asked(rocket, ("wind=none",), (), None, 0, 1, 1, None, None))
    windy = studying.study(studying.Asked(rocket, (), (day,), None, 0, 1, 1, None, None))
    assert "sounding, 2 heights" in windy.cases[0].wind
    assert windy.warnings == ()
    day.write_text(
        "latitude,longitude,height_m,wind direction_degree,wind speed_m/s\n"
        "47.5,8.5,0,90,20\n47.5,8.5,30000,90,20\n"
    )
    (far,) = studying.study(studying.Asked(rocket, (), (day,), None, 0, 1, 1, None, None)).warnings
    assert far.startswith(f"{day.name} is of 47.50 deg, 8.50 deg, ") and "from the launch site" in far
    payload = [one.landed[0].landings[0] for one in (calm, windy)]
    drift = apart(place(payload[0]), place(payload[1]))
    assert drift > 20.0 * 0.5 * (payload[1].t_s - 475.0) * 0.5  # under its parachute it drifts with the wind


@pytest.mark.parametrize(
    ("told", "words"),
    [
        (
            "vehicle.stages.Orion.spent={area: 1 m2, mach: [0, 2], drag: [1, 1, 1]}",
            "3 values for 2 Mach numbers",
        ),
        (
            "vehicle.stages.Orion.spent={area: 1 m2, mach: [0, 2, 1], drag: [1, 1, 1]}",
            "Mach numbers must increase",
        ),
        ("vehicle.stages.Orion.spent={area: 1, mach: [0, 2], drag: [1, 1]}", "spent.area"),
        ("vehicle.stages.Orion.separation=null", "it stays attached and never falls alone"),
    ],
)
def test_a_drag_that_cannot_be_is_told(rocket, told, words):
    with pytest.raises(load.ScenarioError, match=words):
        load.load(rocket, [told])
