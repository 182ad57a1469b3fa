"""Poses of many ticks at once, as the messages that `log.drawings` makes of each.

A message of Foxglove's has one layout as long as its time stamp takes the same number of bytes and none of
its numbers is zero, which protobuf leaves out. The library encodes one of each layout, with numbers that are
found again in its bytes; in the others the numbers and the time stamp are put there. What has a zero is
encoded by the library.

Wire format: https://protobuf.dev/programming-guides/encoding
"""

import struct

import numpy as np

from shefex_nav.compiled import inner, kernel
from shefex_nav.log.wire import varint

MARKS = np.pi * np.arange(1.0, 8.0)  # stand for position and attitude in a template
_SECONDS, _NANOSECONDS = b"\x08", b"\x10"  # tags of a time stamp
_WIDTH = 8  # bytes of a number
_GROUP = 7  # bits in a byte of a whole number


class Poses:
    """Poses in the layouts of their messages.

    ns : (n,) int64, time stamps;  r_l : (n, 3) m;  q_lb : (n, 4)
    """

    def __init__(self, ns, r_l, q_lb):
        self.ns, self.r_l, self.q_lb = ns, r_l, q_lb
        self.numbers = np.concatenate([r_l, q_lb[:, [1, 2, 3, 0]]], axis=1)  # in the order of the messages
        self.unusual, self.groups = [], {}  # rows for the library; bytes of both stamps -> rows
        for k, (stamp, is_usual) in enumerate(
            zip(ns.tolist(), self.numbers.all(axis=1).tolist(), strict=True)
        ):
            seconds, nanoseconds = divmod(stamp, 10**9)
            if is_usual and seconds > 0:
                self.groups.setdefault((_length(seconds), _length(nanoseconds)), []).append(k)
            else:
                self.unusual.append(k)


class PoseMessages:
    """One kind of message about a pose.

    make : function (ns, position (3,), quaternion (4,)) -> a message of Foxglove's
    """

    def __init__(self, make):
        self._make, self._templates = make, {}

    def encode(self, poses):
        """Poses of n instants -> list of n messages as bytes, those of `make`."""
        messages = [None] * len(poses.ns)
        for k in poses.unusual:
            messages[k] = self._make(int(poses.ns[k]), poses.r_l[k], poses.q_lb[k]).encode()
        for lengths, rows in poses.groups.items():
            if lengths not in self._templates:
                self._templates[lengths] = self._template(int(poses.ns[rows[0]]))
            data, number_at, stamp_at = self._templates[lengths]
            filled, size = np.empty((len(rows), len(data)), np.uint8), len(data)
            numbers = poses.numbers[rows].astype("<f8", copy=False).view(np.uint8)
            _fill(data, number_at, stamp_at, lengths, poses.ns[rows], numbers, filled)
            whole = filled.tobytes()
            for k, row in enumerate(rows):
                messages[row] = whole[k * size : (k + 1) * size]
        return messages

    def _template(self, ns):
        """Bytes of a message with MARKS, and where they and the time stamps begin in it."""
        data = self._make(ns, MARKS[:3], MARKS[[6, 3, 4, 5]]).encode()
        number_at = [data.index(struct.pack("<d", mark)) for mark in MARKS]
        seconds, nanoseconds = divmod(ns, 10**9)
        stamp = _SECONDS + varint(seconds) + (_NANOSECONDS + varint(nanoseconds) if nanoseconds else b"")
        stamp_at = [at for at in range(len(data)) if data.startswith(bytes([len(stamp)]) + stamp, at - 1)]
        return np.frombuffer(data, np.uint8).copy(), np.array(number_at), np.array(stamp_at)


def _length(value):
    """Bytes of a whole number in base 128; 0 of zero, which is left out."""
    return -(-value.bit_length() // _GROUP)


@kernel
def _fill(data, number_at, stamp_at, lengths, ns, numbers, filled):
    """Write messages of one layout: filled (m, size) uint8.

    data : (size,) uint8, template;  number_at, stamp_at : where numbers and time stamps begin in it
    lengths : bytes of seconds and of nanoseconds;  ns : (m,);  numbers : (m, 8 * numbers) uint8
    """
    for i in range(len(ns)):
        out = filled[i]
        out[:] = data
        for k in range(len(number_at)):
            for b in range(_WIDTH):
                out[number_at[k] + b] = numbers[i, _WIDTH * k + b]
        for at in stamp_at:
            _put(out, at + 1, lengths[0], ns[i] // 10**9)
            _put(out, at + lengths[0] + 2, lengths[1], ns[i] % 10**9)


@inner
def _put(out, at, length, value):
    """Write a whole number in base 128, least significant group first."""
    for k in range(length):
        more = 0x80 if k < length - 1 else 0
        out[at + k] = (value >> (_GROUP * k)) & 0x7F | more
