"""Bytes on the wire that are no messages: said in words, and soon."""

import socket
import struct
import time

import numpy as np
import pytest

from shefex_nav.errors import CodeError
from shefex_nav.log import wire
from shefex_nav.onboard.own_tracker import Solved
from shefex_nav.software import channels, messages
from shefex_nav.software.codec import Codec
from shefex_nav.software.messages import Done, Ready
from shefex_nav.software.remote import Remote


@pytest.fixture
def ends():
    """Two datagram sockets that are connected."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    yield ours, theirs
    ours.close()
    theirs.close()


def soon():
    return time.monotonic() + 5.0


def test_a_datagram_holds_whole_messages(ends):
    ours, theirs = ends
    channel = channels.Datagrams(ours)
    theirs.send(messages.pack(Ready(True)) + messages.pack(Done(0.5)))
    assert [channel.receive(soon())[0] for _ in range(2)] == ["Ready", "Done"]
    theirs.send(messages.pack(Done(0.5))[:-1])
    with pytest.raises(channels.Silent, match="ends in the middle of a message"):
        channel.receive(soon())


@pytest.mark.parametrize("data", [b"\x00\x00\x00\x00\x00", b"\xff" * 40, b"\x02\x00\x00\x00\x05ab"])
def test_a_length_that_cannot_be_is_no_message(data):
    with pytest.raises(channels.Silent, match="something that is no message"):
        channels.Buffer().add(data)


def test_a_name_that_is_not_ascii_is_not_known():
    name = b"D\xf6ne"
    data = messages.HEAD.pack(1 + len(name), len(name)) + name
    buffer = channels.Buffer()
    buffer.add(data)
    with pytest.raises(CodeError, match="which there is not"):
        Remote(None, 1.0, 1.0)._record(*buffer.next())


def test_a_number_without_end_is_refused_soon():
    """Read to its end, this one would take hours: each byte makes the number longer."""
    topic = next(one for one in messages.OWN if one.record is Done)
    with pytest.raises(ValueError, match="not a message Done"):
        Codec(topic).decode(b"\x80" * 4_000_000)


@pytest.fixture
def solved():
    """Codec of Solved, and a message without objects."""
    codec = Codec(next(one for one in messages.OWN if one.record is Solved))
    return codec, codec.encode(Solved((1.0, 0.0, 0.0, 0.0), 1e-8 * np.eye(3), 0))


def test_numbers_of_an_array_may_come_one_by_one_or_in_pieces(solved):
    """A reader of protobuf takes both: google.protobuf, where the writer says [packed = false], too."""
    codec, data = solved
    numbers = {field.source: number for number, field in enumerate(codec.topic.fields, start=2)}
    for value in (1.0, 2.0, 3.0):
        data += wire.varint(numbers["flux_dn"] << 3 | 1) + struct.pack("<d", value)
    for values in ((1.0, 2.0, 3.0), (4.0, 5.0, 6.0)):
        data += wire.varint(numbers["xy_px"] << 3 | 2) + wire.varint(24) + struct.pack("<3d", *values)
    library = wire.message_class(codec.topic).FromString(data)
    found = codec.decode(data)
    assert found.flux_dn.tolist() == list(library.flux_dn) == [1.0, 2.0, 3.0]
    assert found.xy_px.ravel().tolist() == list(library.xy_px) == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


@pytest.mark.parametrize("more", [b"\x42\x18" + bytes(8), b"\x2d\x00", b"\x29" + bytes(7)])
def test_a_field_that_goes_on_beyond_the_end_is_no_message(solved, more):
    codec, data = solved
    with pytest.raises(ValueError, match="not a message Solved"):
        codec.decode(data + more)
