"""Bytes to a program and back: standard input and output, TCP, UDP."""

import ctypes
import os
import select
import signal
import socket
import subprocess
import sys
import time
from collections import deque
from contextlib import suppress
from functools import partial

from shefex_nav import stopping
from shefex_nav.software.messages import HEAD, split

LARGEST = 65507  # bytes of a datagram
CHUNK = 1 << 16
LONGEST = 1 << 26  # bytes of a message
LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None
PR_SET_PDEATHSIG = 1
ASKED = 300  # times, some 300 us, before a process goes to sleep


class Silent(Exception):
    """No answer has come in time, or the other end is gone; the text says which."""


class Late(Silent):
    """There is no answer by the time at which there must be one."""


def _end_with_parent(parent):
    """In a program before it starts, on Linux: it is killed when the one that starts it is gone.

    Whoever reads its standard input learns that it is closed; one that hangs would go on for ever.
    """
    LIBC.prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # gone already
        os._exit(1)


class Pipe:
    """A program that has been started, by its standard input and output; what it prints to stderr is shown.

    words : of its command
    """

    def __init__(self, words):
        how = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "bufsize": 0}
        if LIBC is not None:
            how["preexec_fn"] = partial(_end_with_parent, os.getpid())
        self._process = subprocess.Popen(words, start_new_session=True, **how)  # Ctrl-C is not for it
        self._in, self._out = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._in, False)
        os.set_blocking(self._out, False)
        self._buffer = Buffer()

    def send(self, data, until_s):
        """All of some bytes, before time.monotonic() is until_s."""
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(self._in, view) :]
            except BlockingIOError:
                _wait([], [self._in], until_s)
            except OSError:
                raise Silent(self._end()) from None

    def receive(self, until_s):
        """The next message: name, body."""
        while (message := self._buffer.next()) is None:
            data = _read(self._out, until_s)
            if not data:
                raise Silent(self._end())
            self._buffer.add(data, until_s)
        return message

    def _end(self):
        """How the program ended, in words."""
        try:
            code = self._process.wait(1.0)
        except subprocess.TimeoutExpired:
            return "it has closed its standard output"
        return f"it was killed by signal {-code}" if code < 0 else f"it ended with exit code {code}"

    def close(self):
        """Let the program end, or end it."""
        for stream in (self._process.stdin, self._process.stdout):
            stream.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if hasattr(os, "killpg"):  # what it has started, too: the program leads a group of its own
            with suppress(OSError):
                os.killpg(self._process.pid, signal.SIGKILL)


class Stream:
    """A TCP connection, or standard input and output of this process. files : sockets or numbers of files"""

    def __init__(self, read, write, close=lambda: None):
        self._read, self._write, self.close = read, write, close
        os.set_blocking(read, False)
        os.set_blocking(write, False)
        self._buffer = Buffer()

    @classmethod
    def of_socket(cls, one):
        """Of a connected socket."""
        one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return cls(one.fileno(), one.fileno(), one.close)

    def send(self, data, until_s=None):
        """As of Pipe; until_s None: however long it takes."""
        view = memoryview(data)
        while view:
            try:
                view = view[os.write(self._write, view) :]
            except BlockingIOError:
                _wait([], [self._write], until_s)
            except OSError as error:
                raise Silent(f"the connection is gone: {error.strerror}") from None

    def receive(self, until_s=None):
        """As of Pipe."""
        while (message := self._buffer.next()) is None:
            try:
                data = _read(self._read, until_s)
            except OSError as error:
                raise Silent(f"the connection is gone: {error.strerror}") from None
            if not data:
                raise Silent("the connection has been closed")
            self._buffer.add(data, until_s)
        return message


class Datagrams:
    """UDP: what is sent at once is one datagram. one : socket; to : address, None: of who was heard last"""

    def __init__(self, one, to=None):
        self._socket, self._to, self._buffer = one, to, Buffer()

    def send(self, data, until_s=None):
        """As of Pipe."""
        if len(data) > LARGEST:
            raise Silent(f"{len(data)} bytes of a tick do not fit into a datagram; use tcp:// for that")
        self._socket.sendto(data, self._to)

    def receive(self, until_s=None):
        """As of Pipe."""
        while (message := self._buffer.next()) is None:
            _wait([self._socket], [], until_s)
            try:
                data, self._to = self._socket.recvfrom(CHUNK)
            except ConnectionError:
                raise Silent("nobody listens there") from None
            self._buffer.add(data, until_s)
            if self._buffer.begun:
                raise Silent("a datagram of its own ends in the middle of a message")
        return message

    def close(self):
        """Close the socket."""
        self._socket.close()


def connected(address, until_s):
    """Channel to a program that listens at 'tcp://host:port' or 'udp://host:port'. Silent"""
    kind, host, port = parts(address)
    if kind == "udp":
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.connect((host, port))
        return Datagrams(_Connected(one))
    try:
        return Stream.of_socket(socket.create_connection((host, port), max(until_s - time.monotonic(), 0.1)))
    except OSError as error:
        raise Silent(f"nobody listens there: {error.strerror or error}") from None


class _Connected:
    """A UDP socket whose other end is known."""

    def __init__(self, one):
        self._socket, self.fileno, self.close = one, one.fileno, one.close

    def sendto(self, data, _to):
        try:
            self._socket.send(data)
        except ConnectionError:
            raise Silent("nobody listens there") from None

    def recvfrom(self, size):
        return self._socket.recv(size), None


def listening(address):
    """Channel of the first who talks to an address of this machine."""
    kind, host, port = parts(address)
    if kind == "udp":
        one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        one.bind((host, port))
        return Datagrams(one)
    with socket.create_server((host, port)) as server:
        return Stream.of_socket(server.accept()[0])


def parts(address):
    """('tcp', host, port) of an address."""
    kind, _, rest = address.partition("://")
    host, _, port = rest.rpartition(":")
    return kind, host, int(port)


def _read(file, until_s):
    """What has come to a file that does not block; for a moment it is asked again and again.

    A process that sleeps is woken late, and finds its caches cold: that would double the time of a tick.
    """
    for _ in range(ASKED):
        try:
            return os.read(file, CHUNK)
        except BlockingIOError:
            os.sched_yield()  # to the other end, if both have one core
    _wait([file], [], until_s)
    return os.read(file, CHUNK)


def _wait(read, write, until_s):
    """Until a file can be read or written. Silent"""
    left_s = None if until_s is None else until_s - time.monotonic()
    with stopping.waiting():
        if (left_s is not None and left_s <= 0.0) or not any(select.select(read, write, [], left_s)):
            raise Late


def check_in_time(until_s):
    """Late if time.monotonic() is past until_s; None: there is no such time."""
    if until_s is not None and time.monotonic() > until_s:
        raise Late


class Buffer:
    """Bytes that have come, and the messages in them."""

    def __init__(self):
        self._data, self._messages = b"", deque()

    def add(self, data, until_s=None):
        """Bytes that have come. Late if they are no whole message yet, and are to be one by until_s."""
        data = self._data + data if self._data else data
        at = 0
        while len(data) - at >= HEAD.size:
            length, n = HEAD.unpack_from(data, at)
            if not n < length <= LONGEST:
                raise Silent(f"it wrote something that is no message: {bytes(data[at : at + 40])!r}")
            end = at + 4 + length
            if len(data) < end:
                break
            self._messages.extend(split(data[at:end]))
            at = end
        self._data = data[at:]
        if not self._messages:
            check_in_time(until_s)

    @property
    def begun(self):
        """Whether a part of a message has come."""
        return bool(self._data)

    def next(self):
        """The next whole message, or None."""
        return self._messages.popleft() if self._messages else None
