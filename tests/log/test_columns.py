"""Messages of columns: those that the records would have given, byte for byte; and their order."""

import math

import numpy as np
import pytest
import synthetic_run
from foxglove import messages as fox

from shefex_nav import records as rec
from shefex_nav.log import drawings, topics, wire
from shefex_nav.log.pose_columns import MARKS, PoseMessages, Poses
from shefex_nav.log.run_data import stack
from shefex_nav.log.steady import PLACES, Steady

SPECIAL = 0.0, -0.0, math.nan, math.inf, -math.inf, 5e-324, 1.7976931348623157e308, 1.0
NS = 1_340_392_680_000_000_000
STEADY = rec.TruthSample, rec.ControlSample, rec.ImuBlock, rec.NavSolution, rec.NavCovariance
STATES = "", "gyro_roll_column mounting", "gyro_scale ä"


def random_rows(record, n, states=None):
    """n records of the type; a third of all floats are special ones."""
    rng, topic = np.random.default_rng(7), topics.of_record(record)
    sizes = {"states": 0, "estimates": 6, "sigmas": 6} if states != "" else {}

    def value(field):
        shape = tuple(4 if size == wire.EQUAL else sizes.get(field.source, 0) if size == -1 else size
                      for size in field.shape)  # fmt: skip
        if field.kind == "string":
            return str(rng.choice(STATES)) if states is None else states
        if field.kind == "bool":
            return bool(rng.integers(2))
        if field.kind != "double":
            return int(rng.integers(5))
        drawn = np.where(rng.random(shape) < 1 / 3, rng.choice(SPECIAL, shape), rng.normal(size=shape))
        return drawn if shape else float(drawn)

    return [record(**{field.source: value(field) for field in topic.fields}) for _ in range(n)]


@pytest.mark.parametrize("record", STEADY, ids=lambda one: one.__name__)
def test_messages_of_columns_are_those_of_the_records(record):
    """Whatever the numbers are; those that protobuf's library leaves out are left out."""
    rows, coder = random_rows(record, 200, "mounting"), wire.codec(topics.of_record(record))
    stamps = NS + 10_000_000 * np.arange(len(rows))
    found = coder.encode_columns(stack(record, rows), stamps)
    assert found == coder.encode(rows, stamps)
    assert coder.encode_columns(stack(record, []), stamps[:0]) == []


@pytest.mark.parametrize("states", [None, *STATES], ids=["mixed", "none", "two", "no ASCII"])
def test_columns_with_text_are_encoded_as_the_library_does(states):
    rows, coder = random_rows(rec.NavCovariance, 60, states), wire.codec(topics.of_record(rec.NavCovariance))
    assert isinstance(coder, wire.VariableCodec) and any(row.t_s == 0.0 for row in rows)
    stamps = NS + np.arange(len(rows))
    for _ in range(2):  # the second time with the layout of the first
        assert coder.encode_columns(stack(rec.NavCovariance, rows), stamps) == coder.encode(rows, stamps)


def test_columns_with_other_numbers_of_samples_are_refused():
    rows, coder = random_rows(rec.ImuBlock, 3), wire.codec(topics.of_record(rec.ImuBlock))
    coder.encode_columns(stack(rec.ImuBlock, rows), NS + np.arange(3))
    fewer = [one._replace(dtheta_b=one.dtheta_b[:2], dv_b=one.dv_b[:2]) for one in rows]
    with pytest.raises(topics.LogError, match=r"a message of \[2\] rows in a log whose others have 4"):
        coder.encode_columns(stack(rec.ImuBlock, fewer), NS + np.arange(3))


def moved(ns, r_l, q_lb):
    """Two frames, of which the second has constants, zeros among them."""
    stamp = fox.Timestamp(ns // 10**9, ns % 10**9)
    x, y, z = r_l.tolist()
    w, *rest = q_lb.tolist()
    turn = fox.Quaternion(x=rest[0], y=rest[1], z=rest[2], w=w)
    first = fox.FrameTransform(
        timestamp=stamp, parent_frame_id="a", child_frame_id="b",
        translation=fox.Vector3(x=x, y=y, z=z), rotation=turn,
    )  # fmt: skip
    second = fox.FrameTransform(
        timestamp=stamp, parent_frame_id="b", child_frame_id="c",
        translation=fox.Vector3(), rotation=fox.Quaternion(x=0.5, y=0.0, z=0.5, w=MARKS[0] / 4),
    )  # fmt: skip
    return fox.FrameTransforms(transforms=[first, second])


STAMPS = [
    0, 1, 127, 128, 10**9 - 1, 10**9, 127 * 10**9 + 127, 128 * 10**9 + 128, 2**28 * 10**9 + 2**28,
    NS, NS + 1, NS + 2**7, NS + 2**14, NS + 2**21, NS + 2**28 - 1, NS + 2**28, NS + 999_999_999,
    (2**32 - 1) * 10**9,
]  # fmt: skip


def test_poses_of_columns_are_those_of_the_library():
    """Stamps of every length in both of their numbers, and every number of a pose special or not."""
    rng = np.random.default_rng(3)
    ns = np.repeat(np.array(STAMPS), 40)
    numbers = np.where(
        rng.random((len(ns), 7)) < 0.05, rng.choice(SPECIAL, (len(ns), 7)), rng.normal(size=(len(ns), 7))
    )
    numbers[::2] = rng.normal(size=numbers[::2].shape)
    r_l, q_lb = numbers[:, :3], numbers[:, 3:]
    expected = [moved(*row).encode() for row in zip(ns.tolist(), r_l, q_lb, strict=True)]
    poses = PoseMessages(moved)
    assert poses.encode(Poses(ns, r_l, q_lb)) == expected
    assert poses.encode(Poses(ns[::-1], r_l[::-1], q_lb[::-1])) == expected[::-1]
    assert poses.encode(Poses(ns[:0], r_l[:0], q_lb[:0])) == []


def test_drawings_of_columns_are_those_of_the_records():
    options = synthetic_run.Options(start_s=231.0, end_s=233.0, frame_pixels=False)
    mission = synthetic_run.mission(start_s=231.0)
    told = list(synthetic_run.simulate(options))
    for kind, one, many in (
        (rec.TruthSample, "truth", "truth_columns"), (rec.NavSolution, "navigation", "navigation_columns")
    ):  # fmt: skip
        rows = [record for record in told if type(record) is kind]
        ns = NS + 10_000_000 * np.arange(len(rows))
        drawn = drawings.Drawings(mission, synthetic_run.NO_PIXELS)
        expected = [
            (topic, k, message.encode())
            for k, row in enumerate(rows)
            for topic, message in getattr(drawn, one)(row, int(ns[k]))
        ]
        found = [
            (topic, k, data)
            for topic, ks, messages in getattr(drawn, many)(stack(kind, rows), ns)
            for k, data in zip(ks.tolist(), messages, strict=True)
        ]
        assert len(expected) == 2 * 41
        assert sorted(found) == sorted(expected)


class Told:
    """Stands for navigator.Columns: tick n has the solution n, every tenth a covariance."""

    def __init__(self):
        self.solution = stack(rec.NavSolution, [_solution(n) for n in range(1, 31)])
        self.covariance = stack(rec.NavCovariance, random_rows(rec.NavCovariance, 3, "mounting"))

    def solutions(self, first, last):
        return rec.NavSolution(*(column[first:last] for column in self.solution)), np.arange(first, last) + 1

    def covariances(self, first, last):
        part = slice(first // 10, last // 10)
        ticks = 10 * (np.arange(3)[part] + 1)
        return rec.NavCovariance(*(column[part] for column in self.covariance)), ticks

    def read(self):
        return [self.solution, self.covariance]


def _solution(n):
    return random_rows(rec.NavSolution, 1)[0]._replace(t_s=float(n))


def test_everything_is_taken_once_and_at_its_place():
    """Wherever the flight stands when it is asked, between two ticks or within one."""
    ticks = np.arange(1, 31)
    truth = stack(rec.TruthSample, [one._replace(t_s=float(n)) for n, one in
                                    zip(ticks, random_rows(rec.TruthSample, 30), strict=True)])  # fmt: skip
    rng = np.random.default_rng(1)
    for _ in range(30):
        steady, taken = Steady([(truth, ticks)], Told()), []
        for place in sorted(rng.choice(31 * PLACES, 6)):
            steady.place = place
            for arrays, places in steady.take():
                assert places.max() < place
                taken += [
                    (type(arrays), *pair) for pair in zip(arrays.t_s.tolist(), places.tolist(), strict=True)
                ]
            of_truth = [t_s for kind, t_s, _ in taken if kind is rec.TruthSample]
            of_nav = [t_s for kind, t_s, _ in taken if kind is rec.NavSolution]
            assert of_truth == list(range(1, len(of_truth) + 1))
            assert of_nav == list(range(1, len(of_nav) + 1))
            # truth of a tick comes before what arrives at it, the solution after
            assert len(of_truth) == max(0, min(30, (place - 2) // PLACES))
            assert len(of_nav) == max(0, min(30, (place - 6) // PLACES))
            assert len(steady.read()[0].t_s) == len(of_truth)
        assert len(set(taken)) == len(taken)
