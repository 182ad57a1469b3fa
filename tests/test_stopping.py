"""When a wish to stop takes effect."""

import os
import signal
import threading
import time

import pytest

from shefex_nav import stopping
from shefex_nav.software import channels


def send(after_s=0.0):
    threading.Timer(after_s, os.kill, (os.getpid(), signal.SIGUSR1)).start()


def test_the_first_wish_takes_effect_between_two_steps_and_the_second_at_once():
    with stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1,)) as asked:
        os.kill(os.getpid(), signal.SIGUSR1)
        assert len(asked) == 1
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGUSR1)


def test_the_first_wish_ends_the_wait_for_another_program():
    """Which may never answer."""
    read, write = os.pipe()
    began_s = time.monotonic()
    with stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1,)) as asked:
        send(after_s=0.2)
        with pytest.raises(KeyboardInterrupt):
            channels.Stream(read, write).receive(began_s + 30.0)
        assert len(asked) == 1 and time.monotonic() - began_s < 10.0
    with stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1,)) as asked:
        os.kill(os.getpid(), signal.SIGUSR1)  # nothing is waited for any more
        assert len(asked) == 1
        with pytest.raises(KeyboardInterrupt):  # nor is a wait begun after a wish
            channels.Stream(read, write).receive(time.monotonic() + 30.0)
    os.close(read)
    os.close(write)


def test_a_step_that_does_not_end_is_given_up_after_the_first_wish(monkeypatch, capfd):
    monkeypatch.setattr(stopping, "PATIENCE_S", 0.2)
    began_s = time.monotonic()
    with (
        stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1, signal.SIGINT)) as asked,
        pytest.raises(KeyboardInterrupt),
    ):
        os.kill(os.getpid(), signal.SIGUSR1)
        time.sleep(30.0)
    assert asked == [signal.SIGUSR1, signal.SIGINT] and 0.1 < time.monotonic() - began_s < 10.0
    assert "given up" in capfd.readouterr().err


def test_work_that_has_ended_is_not_given_up(monkeypatch, capfd):
    monkeypatch.setattr(stopping, "PATIENCE_S", 0.1)
    with stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1, signal.SIGINT)) as asked:
        os.kill(os.getpid(), signal.SIGUSR1)
    time.sleep(0.5)
    assert asked == [signal.SIGUSR1] and capfd.readouterr().err == ""


def test_a_wish_within_the_compiler_waits_for_it(monkeypatch):
    """An exception raised there crashes C code that calls Python."""
    within, put_off = [True], []
    monkeypatch.setattr(stopping, "_is_within_compiler", lambda frame: frame is not None and within[0])
    monkeypatch.setattr(stopping, "_soon", lambda: put_off.append(True))
    monkeypatch.setattr(stopping, "_put_off", [])
    with stopping.wishes(stopping.at_once_if_waiting, (signal.SIGUSR1,)) as asked:
        for _ in range(2):
            os.kill(os.getpid(), signal.SIGUSR1)
        assert len(asked) == 2 and put_off == [True]
        within[0] = False
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGUSR1)
