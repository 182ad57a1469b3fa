"""The scene of the viewer for a rocket, an orbit and a vehicle that stands still."""

import numpy as np
import pytest
import synthetic_run
from rerun.chunk import RrdReader

from shefex_nav import records as rec
from shefex_nav.geometry import wgs84
from shefex_nav.log.run_data import RunDataBuilder
from shefex_nav.log.writer import LogWriter
from shefex_nav.report.track import Track
from shefex_nav.report.viewer import layout, recording, sender, vehicle, world

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
    seen = layout.scene(world.path(data_of(rocket())))
    assert seen.size == pytest.approx(790e3, rel=0.01)
    np.testing.assert_allclose(seen.along, np.array([-110.0, 790.0, 0.0]) / np.hypot(110.0, 790.0), atol=1e-3)
    np.testing.assert_allclose(seen.middle[:2], [-55e3, 395e3], atol=2e3)
    seen = layout.scene(world.path(data_of(orbit())))
    assert 1.7 * RADIUS < seen.size < 2.01 * RADIUS
    seen = layout.scene(world.path(data_of(ground())))
    assert seen.size == layout.SMALLEST_SCENE_M
    assert np.isfinite([*seen.middle, *seen.along]).all() and np.linalg.norm(seen.along) == pytest.approx(1.0)


@pytest.mark.parametrize("fly", [orbit, ground, rocket])
def test_every_kind_of_flight_makes_a_recording(fly, tmp_path):
    log, saved = tmp_path / "run.mcap", tmp_path / "run.rrd"
    with LogWriter(log, MISSION, synthetic_run.NO_PIXELS) as writer:
        for record in fly():
            writer.write(record)
    recording.build([log], saved)
    entities = {str(chunk.entity_path) for chunk in RrdReader(saved).stream()}
    assert {"/world/path", "/world/globe", "/world/ground_track", "/plots/height"} <= entities
    assert not any(name.startswith("/plots/pointing") for name in entities)


def track(latitude_deg, longitude_deg):
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    return Track(None, None, latitude, longitude, None)


def test_the_graticule_is_around_the_track():
    lines, _ = world._graticule(track([47.0, 49.0], [179.0, -178.0]))  # over the date line
    points = np.concatenate(lines)
    longitude = np.degrees(np.arctan2(points[:, 1], points[:, 0])) % 360.0
    assert 165.0 < longitude.min() and longitude.max() < 195.0
    lines, is_round = world._graticule(track([-51.0, 0.0, 51.0], [0.0, 120.0, -120.0]))
    points = np.concatenate(lines)
    np.testing.assert_allclose(points.max(axis=0)[:2], wgs84.A, rtol=2e-3)  # the whole globe
    np.testing.assert_allclose(points.min(axis=0)[:2], -wgs84.A, rtol=2e-3)
    assert len(lines) == len(is_round) < 80


@pytest.mark.parametrize(
    ("n", "rate", "step"), [(1000, 100.0, 10), (1000, 10.0, 1), (120_000, 10.0, 6), (1, 1.0, 1)]
)
def test_curves_have_ten_points_a_second_but_not_too_many(n, rate, step):
    assert sender.plot_step(np.arange(n) / rate) == step


@pytest.mark.parametrize("n", [0, 1, 7, 5000, 90_000])
def test_curves_of_the_viewer_keep_their_peaks(n):
    """A sample of 14.4 m/s at 100 Hz is not between two of the ten points of its second."""
    values = 0.1 * np.random.default_rng(2).normal(size=n)
    values[n // 2 : n // 2 + 1] = 14.4
    rows = sender.plotted(np.arange(n) / 100.0, values)
    assert len(rows) <= max(12, n // 10 + 4, min(n, 7))
    assert values[rows].max(initial=0.0) == values.max(initial=0.0)
    assert n < 2 or (rows[0], rows[-1]) == (0, n - 1)


def test_the_rocket_is_closed_and_points_along_x():
    """Every edge of the body belongs to two triangles, in opposite directions; its volume is positive."""
    vertices, triangles = vehicle.rocket_mesh(2.0)
    assert vertices[:, 0].max() == 1.0 and vertices[:, 0].min() == -1.0
    assert vertices[np.argmax(vertices[:, 0]), 1:] == pytest.approx([0.0, 0.0])
    body = triangles[: 4 * vehicle.SIDES]
    edges = [(t[k], t[(k + 1) % 3]) for t in body.tolist() for k in range(3)]
    assert len(set(edges)) == len(edges)
    assert {(b, a) for a, b in edges} == set(edges)
    a, b, c = (vertices[body[:, k]] for k in range(3))
    assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0 > 0.0


def test_a_cone_has_its_angle_and_length():
    axis = np.array([0.3, -0.5, 0.8])
    ring, *lines = vehicle.cone_lines(axis, 0.4, 5.0)
    assert np.linalg.norm(ring, axis=1) == pytest.approx(5.0)
    assert ring @ axis / np.linalg.norm(axis) == pytest.approx(5.0 * np.cos(0.4))
    assert len(lines) == 8 and all(np.array_equal(line[0], np.zeros(3)) for line in lines)


def test_coasts_are_those_near_the_track():
    """Of a flight from Andoya there is Norway, 69 deg north, and not Africa."""
    lines = world._coasts(track(np.linspace(69.3, 76.0, 101), np.linspace(16.0, 10.0, 101)))
    points = np.concatenate(lines)
    latitude = np.degrees(np.arcsin(points[:, 2] / np.linalg.norm(points, axis=1)))
    assert latitude.min() > 50.0
    assert len(points) > 100
