"""The camera on command: pictures that are taken ahead of time are those of their own ticks."""

from typing import NamedTuple

import numpy as np
import pytest
from camera_bench import CLEAN, T_S, build, turning

from shefex_nav.geometry.shutter import duration_s, row_times
from shefex_nav.records import CameraCommand
from shefex_nav.settings import changed
from shefex_nav.world.camera import shutter as shutters

KINDS = {
    "global": CLEAN,
    "rolling": changed(CLEAN, {"detector.shutter": "rolling", "detector.line_time": 0.05 / 493}),
}
LAST_S = T_S + 2.0
LAST = 260  # tick, with which the trajectory ends
ENDS_S = [T_S + 0.01 * n for n in range(1, LAST + 1)]


class Taken(NamedTuple):
    """What stands for a picture."""

    t_available_s: float
    number: int
    t_start_s: float
    command: CameraCommand
    draw: float  # of the generator


def taken(params, every, is_ahead):
    """Pictures as a run takes them: (tick and time of the arrival, number, start, command, draw) of each.

    Each that arrives commands another exposure, from its own tick or from a later one on. Ahead of time, as
    the route does it, means as far as the next arrival, which might bring a command.

    Returns
    -------
    pictures; how many were taken ahead; the tick from which on `next_tick` is inf, after the first command
    """
    device = build(params)
    trajectory = turning(110.0, 50.0, duration_s=0.01 * LAST)

    def take(device, command, trajectory, number, t_start_s, rng):
        times = row_times(command.exposure_s, params.detector.line_s, params.detector.rows)
        end_s = t_start_s + duration_s(times) + params.detector.readout
        return Taken(end_s, number, t_start_s, command, rng.random()), None

    rng = np.random.default_rng(1)
    shutter = shutters.Shutter(device, trajectory, every=every, last_s=LAST_S, rng=rng, take=take)
    pictures, ahead, over = [], 0, None
    assert shutter.next_tick(0) == np.inf  # off, until it is commanded
    for n in range(1, LAST + 1):
        now_s = T_S + 0.01 * n
        arrived = [frame for frame, _ in shutter.arrived(now_s)]
        commands = [CameraCommand(now_s, 0.05, 24.0)] if n == 5 else []
        for frame in arrived:
            pictures.append((n, *frame))
            from_s = now_s + 0.1 * (frame.number % 3 == 2)
            commands.append(CameraCommand(from_s, 0.02 + 0.01 * (frame.number % 4), 24.0))
        shutter.tick(n, now_s, commands)
        if is_ahead:
            before = shutter.number
            comes = shutter.ahead(n, LAST, ENDS_S)
            assert comes == min(LAST, np.ceil((shutter.next_s - T_S - 1e-6) / 0.01))
            ahead += shutter.number - before
        if n >= 5 and over is None and shutter.next_tick(n) == np.inf:
            over = n
    return pictures, ahead, over


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("every", [4, 6, 10])
def test_pictures_taken_ahead_of_time_are_those_of_their_ticks(kind, every):
    params = KINDS[kind]
    expected, none, over = taken(params, every, False)
    found, ahead, _ = taken(params, every, True)
    assert found == expected
    assert none == 0 and ahead > 0.7 * len(expected)
    commands = [command for *_, command, _ in expected]
    assert len(expected) > 0.8 * 200 / every and len({command.exposure_s for command in commands}) == 4
    assert len({command.t_s for command in commands}) > 5
    assert max(available_s for _, available_s, *_ in expected) <= LAST_S
    # not even a picture without an exposure would be read out in time from then on
    assert over == next(
        n for n in range(0, LAST, every) if T_S + 0.01 * n + params.detector.readout > LAST_S + 1e-6
    )


def test_a_command_that_comes_too_late_for_a_picture_is_refused():
    device, command = build(CLEAN), CameraCommand(T_S, 0.05, 24.0)
    shutter = shutters.Shutter(
        device,
        turning(110.0, 50.0),
        every=4,
        last_s=LAST_S,
        rng=np.random.default_rng(1),
        take=lambda *_: None,
    )
    shutter.tick(8, ENDS_S[7], [command])
    shutter.tick(8, ENDS_S[7])
    with pytest.raises(ValueError, match=r"at tick 7 .* until 8"):
        shutter.tick(7, ENDS_S[6], [command])
