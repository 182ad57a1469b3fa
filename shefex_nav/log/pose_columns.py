"""Poses of many ticks at once, as the messages that `log.drawings` makes of each.

A message of Foxglove's has one layout as long as its time stamp takes the same number of bytes and none of
its numbers is zero, which protobuf leaves out. The library encodes one of each layout, with numbers that are
found again in its bytes; in the others the numbers and the time stamp are put there. What has a zero is
encoded by the library.

Wire format: https://protobuf.dev/programming-guides/encoding
"""

import struct
from collections import defaultdict

import numpy as np

from shefex_nav.log.wire import varint

MARKS = np.pi * np.arange(1.0, 8.0)  # stand for position and attitude in a template
_SECONDS, _NANOSECONDS = b"\x08", b"\x10"  # tags of a time stamp
_GROUP = 7  # bits in a byte of a number of any length


class PoseMessages:
    """One kind of message about a pose.

    make : function (ns, position (3,), quaternion (4,)) -> a message of Foxglove's
    """

    def __init__(self, make):
        self._make, self._templates = make, {}

    def encode(self, ns, r_l, q_lb):
        """(n,) int64, (n, 3) m, (n, 4) -> list of n messages as bytes, those of `make`."""
        numbers = np.concatenate([r_l, q_lb[:, [1, 2, 3, 0]]], axis=1)  # in the order of the message
        seconds, nanoseconds = np.divmod(ns, 10**9)
        lengths = np.stack([_length(seconds), _length(nanoseconds)], axis=1)
        usual = (numbers != 0.0).all(axis=1) & (seconds > 0)
        of_length, messages = defaultdict(list), [None] * len(ns)
        for k, (is_usual, key) in enumerate(zip(usual.tolist(), map(tuple, lengths.tolist()), strict=True)):
            if is_usual:
                of_length[key].append(k)
            else:
                messages[k] = self._make(int(ns[k]), r_l[k], q_lb[k]).encode()
        for key, ks in of_length.items():
            found = self._filled(key, ns[ks], np.stack([seconds, nanoseconds])[:, ks], numbers[ks])
            for k, message in zip(ks, found, strict=True):
                messages[k] = message
        return messages

    def _filled(self, key, ns, stamps, numbers):
        """Messages of one layout: list of bytes. key : bytes of the two stamps;  stamps : (2, n)"""
        if key not in self._templates:
            self._templates[key] = self._template(int(ns[0]))
        data, number_at, stamp_at = self._templates[key]
        filled = np.tile(data, (len(ns), 1))
        for k, at in enumerate(number_at):
            filled[:, at : at + 8] = np.ascontiguousarray(numbers[:, k], "<f8").view("u1").reshape(-1, 8)
        for at in stamp_at:
            _put(filled[:, at + 1 :], stamps[0], key[0])
            _put(filled[:, at + key[0] + 2 :], stamps[1], key[1])
        whole, size = filled.tobytes(), len(data)
        return [whole[begin : begin + size] for begin in range(0, len(whole), size)]

    def _template(self, ns):
        """Bytes of a message with MARKS, and where they and the time stamps begin in it."""
        data = self._make(ns, MARKS[:3], MARKS[[6, 3, 4, 5]]).encode()
        number_at = [data.index(struct.pack("<d", mark)) for mark in MARKS]
        seconds, nanoseconds = divmod(ns, 10**9)
        stamp = _SECONDS + varint(seconds) + (_NANOSECONDS + varint(nanoseconds) if nanoseconds else b"")
        stamp_at = [at for at in range(len(data)) if data.startswith(bytes([len(stamp)]) + stamp, at - 1)]
        return np.frombuffer(data, "u1"), number_at, stamp_at


def _length(values):
    """Bytes of numbers in base 128; 0 of zero, which is left out. (n,) int64 -> (n,)"""
    return np.searchsorted(1 << (_GROUP * np.arange(5)), values, side="right")


def _put(where, values, length):
    """Write numbers of the same length in base 128. where : (n, >= length) u1;  values : (n,)"""
    for k in range(length):
        more = 0x80 if k < length - 1 else 0
        where[:, k] = (values >> (_GROUP * k)) & 0x7F | more
