"""The scene of the viewer for a rocket, an orbit and a vehicle that stands still."""

import numpy as np
import pytest
import synthetic_run
from rerun.chunk import RrdReader

from shefex_nav import records as rec
from shefex_nav.geometry import wgs84
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.writer import LogWriter
from shefex_nav.report import layout, viewer, world_view
from shefex_nav.report.track import Track

MISSION = synthetic_run.mission(start_s=0.0)
RADIUS = wgs84.A + 400e3


def sample(t_s, r_i, v_i, phase):
    return rec.TruthSample(t_s, int(phase), r_i, v_i, np.array([1.0, 0, 0, 0]), np.zeros(3), np.zeros(3), 0.0)


def orbit():
    """Two revolutions in steps of a minute."""
    rate = np.sqrt(wgs84.GM / RADIUS**3)
    for k in range(186):
        u = rate * 60.0 * k
        across = np.array([0.0, np.cos(0.9), np.sin(0.9)])
        r_i = RADIUS * (np.cos(u) * np.array([1.0, 0, 0]) + np.sin(u) * across)
        v_i = RADIUS * rate * (-np.sin(u) * np.array([1.0, 0, 0]) + np.cos(u) * across)
        yield sample(60.0 * k, r_i, v_i, rec.Phase.ORBIT)


def ground():
    """Ten seconds on the pad of the made-up mission."""
    for k in range(101):
        truth = synthetic_run.truth_at(MISSION._replace(start_s=-10.0), -10.0 + 0.1 * k)
        yield truth._replace(t_s=0.1 * k, phase=int(rec.Phase.GROUND))


def rocket():
    for k in range(1000):
        yield synthetic_run.truth_at(MISSION, 0.495 * k)


def data_of(records):
    builder = RunDataBuilder(MISSION)
    for record in records:
        builder.add(record)
    return builder.build()


def test_the_scene_has_the_size_of_the_flight():
    seen = layout.scene(world_view.path(data_of(rocket())))
    assert seen.size == pytest.approx(790e3, rel=0.01)
    np.testing.assert_allclose(seen.along, np.array([-110.0, 790.0, 0.0]) / np.hypot(110.0, 790.0), atol=1e-3)
    np.testing.assert_allclose(seen.middle[:2], [-55e3, 395e3], atol=2e3)
    seen = layout.scene(world_view.path(data_of(orbit())))
    assert 1.7 * RADIUS < seen.size < 2.01 * RADIUS
    seen = layout.scene(world_view.path(data_of(ground())))
    assert seen.size == layout.SMALLEST_SCENE_M
    assert np.isfinite([*seen.middle, *seen.along]).all() and np.linalg.norm(seen.along) == pytest.approx(1.0)


@pytest.mark.parametrize("fly", [orbit, ground, rocket])
def test_every_kind_of_flight_makes_a_recording(fly, tmp_path):
    log, recording = tmp_path / "run.mcap", tmp_path / "run.rrd"
    with LogWriter(log, MISSION, synthetic_run.NO_PIXELS) as writer:
        for record in fly():
            writer.write(record)
    viewer.build_recording(log, recording)
    entities = {str(chunk.entity_path) for chunk in RrdReader(recording).stream()}
    assert {"/world/path", "/world/globe", "/world/ground_track", "/plots/height"} <= entities
    assert not any(name.startswith("/plots/pointing") for name in entities)


def track(latitude_deg, longitude_deg):
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    return Track(None, None, latitude, longitude, None)


def test_the_graticule_is_around_the_track():
    lines, _ = world_view._graticule(track([47.0, 49.0], [179.0, -178.0]))  # over the date line
    points = np.concatenate(lines)
    longitude = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0
    assert 165.0 < longitude.min() and longitude.max() < 195.0
    lines, is_round = world_view._graticule(track([-51.0, 0.0, 51.0], [0.0, 120.0, -120.0]))
    points = np.concatenate(lines)
    np.testing.assert_allclose(points.max(axis=0)[:2], wgs84.A, rtol=2e-3)  # the whole globe
    np.testing.assert_allclose(points.min(axis=0)[:2], -wgs84.A, rtol=2e-3)
    assert len(lines) == len(is_round) < 80


@pytest.mark.parametrize(
    ("n", "rate", "step"), [(1000, 100.0, 10), (1000, 10.0, 1), (120_000, 10.0, 6), (1, 1.0, 1)]
)
def test_curves_have_ten_points_a_second_but_not_too_many(n, rate, step):
    assert viewer.plot_step(np.arange(n) / rate) == step
