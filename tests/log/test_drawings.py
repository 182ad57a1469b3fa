"""What Foxglove messages say, against the records they come from."""

import numpy as np
import pytest
import synthetic_run
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from scipy.spatial.transform import Rotation

from shefex_nav import records as rec
from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import dcm_ie
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.log.drawings import Drawings, FramePolicy, thresholded


@pytest.fixture
def drawings():
    return Drawings(synthetic_run.mission(), synthetic_run.THRESHOLDED)


def decoded(drawing):
    """{topic: message} of a drawing, read with the schema that Foxglove's SDK stores."""
    found = {}
    for topic, message in drawing:
        schema = message.get_schema()
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        kind = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
        found[topic] = kind.FromString(message.encode())
    return found


def rotation(q):
    return Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()


def test_poses_are_in_axes_of_the_launch_site(drawings):
    mission = synthetic_run.mission()
    truth = synthetic_run.truth_at(mission, 300.0)
    messages = decoded(drawings.truth(truth, 1))
    pose = messages["/truth/pose"].pose
    expected, _ = synthetic_run._position_l(300.0)  # how the position was made
    np.testing.assert_allclose([pose.position.x, pose.position.y, pose.position.z], expected, atol=1e-6)
    C_le = wgs84.dcm_el(mission.launch_latitude, mission.launch_longitude).T
    C_lb = C_le @ dcm_ie(mission.earth, 300.0).T @ dcm_from_quat(truth.q_ib)
    np.testing.assert_allclose(rotation(pose.orientation), C_lb, atol=1e-12)
    body, camera = messages["/tf"].transforms
    assert (body.parent_frame_id, body.child_frame_id) == ("launch", "body")
    assert (camera.parent_frame_id, camera.child_frame_id) == ("body", "star_camera")
    np.testing.assert_allclose(rotation(camera.rotation), mission.C_bc, atol=1e-12)


def test_poses_are_drawn_twenty_times_a_second(drawings):
    mission = synthetic_run.mission()
    drawn = [len(list(drawings.truth(synthetic_run.truth_at(mission, 10 + n / 100), 1))) for n in range(100)]
    assert sum(1 for n in drawn if n) == 20


def test_location_covariance_is_east_north_up(drawings):
    mission = synthetic_run.mission()
    latitude, longitude = mission.launch_latitude, mission.launch_longitude
    C_el = wgs84.dcm_el(latitude, longitude)
    R_l = np.diag([1.0, 4.0, 9.0])
    r_e = wgs84.ecef_from_geodetic(latitude, longitude, 5000.0)
    fix = rec.GpsFix(1.0, 1.2, True, r_e, np.zeros(3), C_el @ R_l @ C_el.T, np.eye(3), 8, 2.0, "")
    location = decoded(drawings.gps(fix, 1))["/gps/location"]
    np.testing.assert_allclose(location.position_covariance, R_l.ravel(), atol=1e-12)
    assert location.latitude == pytest.approx(69.2942, abs=1e-12)
    assert location.altitude == pytest.approx(5000.0, abs=1e-6)
    assert list(drawings.gps(fix._replace(valid=False), 1)) == []


def test_identified_stars_are_named_and_pixels_count_from_the_corner(drawings):
    found = rec.Detections(
        np.array([[10.0, 20.0], [0.0, 0.0]]), np.ones(2), np.ones(2), np.zeros(2), np.zeros((2, 2, 2))
    )
    nan = np.full(4, np.nan)
    fix = rec.StarFix(
        1, 1.0, 1.1, rec.Reason.NONE, nan, np.eye(3), found, np.array([0, 71683]), 0.1, 9, 0.1, False, False
    )
    messages = decoded(drawings.star_fix(fix, 1))
    annotations = messages["/star_tracker/annotations"]
    assert [text.text for text in annotations.texts] == ["HIP 71683"]
    assert [(p.x, p.y) for p in annotations.points[0].points] == [(10.5, 20.5), (0.5, 0.5)]
    assert messages["/log"].message == "star tracker: attitude found"
    assert "/log" not in dict(drawings.star_fix(fix, 1))  # said once
    lost = drawings.star_fix(fix._replace(reason=rec.Reason.NO_MATCH), 1)
    assert decoded(lost)["/log"].message == "star tracker: no attitude: no match"


def test_a_gate_speaks_once_until_it_has_news(drawings):
    def said(note, nis=20.0):
        gate = rec.GateResult(1.0, 1.0, "gps_position", 3, nis, 16.3, False, note, np.zeros(3))
        return [message.message for message in decoded(drawings.gate(gate, 1)).values()]

    assert said("") == []
    assert said("rejected") == ["gps position: rejected (NIS 20.0, limit 16.3)"]
    assert said("rejected") == []
    assert said("no fix: lost", nis=np.nan) == ["gps position: no fix: lost"]
    assert said("") == []
    assert said("rejected") != []


def test_thresholding_keeps_stars_and_drops_the_sky():
    rng = np.random.default_rng(5)
    for mean, sigma in ((12.0, 2.0), (3.0, 1.0), (90.0, 6.0)):
        sky = rng.normal(mean, sigma, (493, 659))
        rows, columns = rng.integers(5, 480, 40), rng.integers(5, 480, 40)
        sky[rows, columns] += 8.0 * sigma + 4.0
        image = sky.clip(0, 255).round().astype(np.uint8)
        kept = thresholded(image, 4.0)
        np.testing.assert_array_equal(kept[kept > 0], image[kept > 0])
        assert np.all(kept[rows, columns] == image[rows, columns])
        # 4 sigma: 3.2e-5 of a normal sky; rounding to whole grey values lets a few more through
        assert np.count_nonzero(kept) - 40 < 4e-4 * image.size


def test_thresholding_against_numpy():
    """The background clipped three times, from the grey values of every sixteenth row themselves."""
    image = np.random.default_rng(6).normal(20.0, 3.0, (480, 640)).clip(0, 255).astype(np.uint8)
    image[::40, ::40] = 255
    values = image[::16].astype(float)
    low, high = 0.0, 2.0 * np.median(values) + 4.0
    for _ in range(3):
        inside = values[(values >= low) & (values <= high)]
        margin = 4.0 * inside.std() + 1.0
        low, high = inside.mean() - margin, inside.mean() + margin
    threshold = np.ceil(inside.mean() + 3.0 * inside.std())
    np.testing.assert_array_equal(thresholded(image, 3.0), np.where(image >= threshold, image, 0))


def test_thresholding_an_even_frame():
    assert np.count_nonzero(thresholded(np.zeros((64, 64), np.uint8), 4.0)) == 0
    assert thresholded(np.full((64, 64), 255, np.uint8), 4.0).dtype == np.uint8


@pytest.mark.parametrize("scale", [1, 16, 257])
def test_thresholding_more_bits(scale):
    """Grey values in finer steps: the same pixels stay, against the same computation in NumPy."""
    image = np.random.default_rng(7).normal(20.0, 3.0, (480, 640)).clip(0, 255).astype(np.uint16)
    image[::40, ::40] = 255
    image *= np.uint16(scale)
    values = image[::16].astype(float)
    low, high = 0.0, 2.0 * np.median(values) + 4.0
    for _ in range(3):
        inside = values[(values >= low) & (values <= high)]
        margin = 4.0 * inside.std() + 1.0
        low, high = inside.mean() - margin, inside.mean() + margin
    threshold = np.ceil(inside.mean() + 3.0 * inside.std())
    kept = thresholded(image, 3.0)
    assert kept.dtype == np.uint16
    np.testing.assert_array_equal(kept, np.where(image >= threshold, image, 0))
    assert np.all(kept[::40, ::40] == 255 * scale)


def test_pictures_say_how_many_bytes_a_grey_value_has():
    image = np.arange(12, dtype=np.uint16).reshape(3, 4) * 300
    drawings = Drawings(synthetic_run.mission(), FramePolicy(1, "none", 4.0))
    frame = rec.Frame(0, 0.0, 0.025, 0.06, 0.05, 0.0, image, 1e-4, 12)
    message = decoded(drawings.frame(frame, 1))["/star_tracker/image_full"]
    assert (message.encoding, message.width, message.height, message.step) == ("mono16", 4, 3, 8)
    np.testing.assert_array_equal(np.frombuffer(message.data, "<u2").reshape(3, 4), image)
    narrow = frame._replace(image_dn=image.astype(np.uint8), bits=8)
    message = decoded(drawings.frame(narrow, 1))["/star_tracker/image_full"]
    assert (message.encoding, message.step, len(message.data)) == ("mono8", 4, 12)
