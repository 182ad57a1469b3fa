"""What of a log Foxglove draws is as its documentation asks for: schemas, encodings, frames, times.

Foxglove itself is not run here. It knows its schemas by name and reads them by field number, so both are
compared with the ones that it publishes.
"""

import re

import numpy as np
import pytest
import synthetic_run
from google.protobuf.descriptor_pb2 import DescriptorProto, FieldDescriptorProto, FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from shefex_nav.log.drawings import CHANNELS, FramePolicy
from shefex_nav.log.writer import LogWriter

OPTIONS = synthetic_run.Options(start_s=231.0, end_s=236.0)
ROOT = "launch"
# number, type (* repeated) and name of each field, from the package foxglove-schemas-protobuf 0.4.0
OFFICIAL = {
    "CameraCalibration": (
        "1 Timestamp timestamp, 2 fixed32 width, 3 fixed32 height, 4 string distortion_model, 5 "
        "double* D, 6 double* K, 7 double* R, 8 double* P, 9 string frame_id"
    ),
    "CircleAnnotation": (
        "1 Timestamp timestamp, 2 Point2 position, 3 double diameter, 4 double thickness, 5 Color "
        "fill_color, 6 Color outline_color, 7 KeyValuePair* metadata"
    ),
    "Color": "1 double r, 2 double g, 3 double b, 4 double a",
    "FrameTransform": (
        "1 Timestamp timestamp, 2 string parent_frame_id, 3 string child_frame_id, 4 Vector3 "
        "translation, 5 Quaternion rotation"
    ),
    "FrameTransforms": "1 FrameTransform* transforms",
    "ImageAnnotations": (
        "1 CircleAnnotation* circles, 2 PointsAnnotation* points, 3 TextAnnotation* texts, 4 "
        "KeyValuePair* metadata, 5 Timestamp timestamp"
    ),
    "KeyValuePair": "1 string key, 2 string value",
    "LocationFix": (
        "1 double latitude, 2 double longitude, 3 double altitude, 4 double* position_covariance, "
        "5 PositionCovarianceType position_covariance_type, 6 Timestamp timestamp, 7 string "
        "frame_id, 8 Color color, 9 KeyValuePair* metadata, 10 double heading, 11 Vector3 "
        "velocity"
    ),
    "Log": (
        "1 Timestamp timestamp, 2 Level level, 3 string message, 4 string name, 5 string file, 6 fixed32 line"
    ),
    "Point2": "1 double x, 2 double y",
    "PointsAnnotation": (
        "1 Timestamp timestamp, 2 Type type, 3 Point2* points, 4 Color outline_color, 5 Color* "
        "outline_colors, 6 Color fill_color, 7 double thickness, 8 KeyValuePair* metadata"
    ),
    "Pose": "1 Vector3 position, 2 Quaternion orientation",
    "PoseInFrame": "1 Timestamp timestamp, 2 string frame_id, 3 Pose pose",
    "Quaternion": "1 double x, 2 double y, 3 double z, 4 double w",
    "RawImage": (
        "1 Timestamp timestamp, 2 fixed32 width, 3 fixed32 height, 4 string encoding, 5 fixed32 "
        "step, 6 bytes data, 7 string frame_id"
    ),
    "TextAnnotation": (
        "1 Timestamp timestamp, 2 Point2 position, 3 string text, 4 double font_size, 5 Color "
        "text_color, 6 Color background_color, 7 KeyValuePair* metadata"
    ),
    "Vector3": "1 double x, 2 double y, 3 double z",
}
KINDS = {
    number: name.removeprefix("TYPE_").lower() for name, number in FieldDescriptorProto.Type.items()
}  # fmt: skip


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("foxglove") / "run.mcap"
    with LogWriter(path, synthetic_run.mission(), FramePolicy(10, "thresholded", 4.0)) as log:
        for record in synthetic_run.simulate(OPTIONS):
            log.write(record)
    return path


@pytest.fixture(scope="module")
def messages(log):
    """{topic: [(log time ns, message)]} of the topics that are drawn."""
    found = {}
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages(topics=list(CHANNELS)):
            found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def described(message):
    """The fields of a DescriptorProto as in OFFICIAL."""
    parts = []
    for field in sorted(message.field, key=lambda field: field.number):
        kind = field.type_name.rpartition(".")[2] or KINDS[field.type]
        many = "*" if field.label == FieldDescriptorProto.LABEL_REPEATED else ""
        parts.append(f"{field.number} {kind}{many} {field.name}")
    return ", ".join(parts)


def test_the_schemas_in_the_file_are_those_of_foxglove(log):
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    schemas = {channel.topic: summary.schemas[channel.schema_id] for channel in summary.channels.values()}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"protobuf"}
    for topic, channel_class in CHANNELS.items():
        assert schemas[topic].encoding == "protobuf"
        assert schemas[topic].name == f"foxglove.{channel_class.removesuffix('Channel')}"
        files = FileDescriptorSet.FromString(schemas[topic].data).file
        described_here = {
            one.name: one for file in files if file.package == "foxglove" for one in file.message_type
        }
        assert schemas[topic].name.removeprefix("foxglove.") in described_here
        for name, message in described_here.items():
            assert described(message) == OFFICIAL[name], f"{topic}: {name}"


def test_a_field_that_differs_would_be_seen():
    message = DescriptorProto(name="Point2")
    for number, name in ((1, "y"), (2, "x")):
        message.field.add(number=number, name=name, type=FieldDescriptorProto.TYPE_DOUBLE)
    assert described(message) == "1 double y, 2 double x" != OFFICIAL["Point2"]


def test_every_frame_is_reached_from_the_launch_site(messages):
    """By the transforms that have been sent by then: a panel cannot draw what hangs on nothing."""
    times, parents = {}, {}
    for _, message in messages["/tf"]:
        for transform in message.transforms:
            child = transform.child_frame_id
            assert parents.setdefault(child, transform.parent_frame_id) == transform.parent_frame_id
            times.setdefault(child, transform.timestamp.ToNanoseconds())
    seen = set()
    for topic in ("/truth/pose", "/nav/pose", "/star_tracker/image", "/star_tracker/calibration"):
        for _, message in messages[topic]:
            frame, stamp = message.frame_id, message.timestamp.ToNanoseconds()
            seen.add(frame)
            for _ in range(5):
                if frame == ROOT:
                    break
                assert topic == "/star_tracker/calibration" or times[frame] <= stamp
                frame = parents[frame]
            assert frame == ROOT
    assert {"launch", "star_camera"} <= seen


def test_turns_are_unit_quaternions(messages):
    for _, message in messages["/tf"][::20]:
        for transform in message.transforms:
            q = transform.rotation
            assert np.linalg.norm([q.x, q.y, q.z, q.w]) == pytest.approx(1.0, abs=1e-9)


def test_pictures_are_whole_and_annotations_belong_to_them(messages):
    stamps = set()
    for topic in ("/star_tracker/image", "/star_tracker/image_full"):
        for _, image in messages[topic]:
            assert re.fullmatch("mono(8|16)", image.encoding)  # both are among the ones of the Image panel
            assert image.step == image.width * int(image.encoding[4:]) // 8
            assert len(image.data) == image.step * image.height
            stamps.add(image.timestamp.ToNanoseconds())
    camera = messages["/star_tracker/calibration"][0][1]
    assert (camera.width, camera.height) == (image.width, image.height)
    assert len(camera.K) == len(camera.R) == 9 and len(camera.P) == 12
    annotations = [message for _, message in messages["/star_tracker/annotations"]]
    assert len(annotations) > 40
    for annotation in annotations:
        assert {one.timestamp.ToNanoseconds() for one in annotation.circles} <= stamps
        assert all(0.0 <= one.position.x <= image.width for one in annotation.circles)
