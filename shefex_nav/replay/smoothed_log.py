"""The log of a smoothed flight: what `report` and `view` need, with the smoother's solution in it."""

from itertools import chain

from shefex_nav import __version__
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.topics import SMOOTHED, RunSummary
from shefex_nav.log.writer import LogWriter
from shefex_nav.records import ComputeTime, row
from shefex_nav.replay.rerun import Recording, not_seen_on_board

NO_PICTURES = FramePolicy(0, "none", 4.0)


def write(path, recording: Recording, smoothed, wall_s, *, overwrite=False):
    """Write the log.

    Parameters
    ----------
    path : file
    recording : Recording that was smoothed
    smoothed : RunData
    wall_s : how long it took
    overwrite : a file that exists is lost
    """
    mission = smoothed.mission._replace(
        scenario=SMOOTHED.format(smoothed.mission.scenario),
        scenario_text=recording.scenario_text,
        version=__version__,
    )
    end_s = float(smoothed.nav.t_s[-1])
    with LogWriter(path, mission, NO_PICTURES, overwrite=overwrite) as log:
        for record in records(smoothed):
            log.write(record)
        log.write(RunSummary(end_s, wall_s, 0.0, smoothed.cut_s))


def records(data):
    """Records of a RunData in order of time, without the pixels and the IMU: a generator."""
    if data.alignment is not None:
        yield data.alignment
    pairs = not_seen_on_board(data)
    lists = [data.gps, data.gps_ranges, data.star_fixes, data.gates]
    pairs += [(record.t_valid_s, record) for record in chain(*lists)]
    for arrays in data.readings.values():
        pairs += [(t_s, row(arrays, k)) for k, t_s in enumerate(arrays.t_valid_s.tolist())]
    pairs += [(record.t_s, record) for record in data.health]
    for arrays in (data.nav, data.covariance):
        pairs += [(t_s, row(arrays, k)) for k, t_s in enumerate(arrays.t_s.tolist())]
    times = data.compute_times
    pairs += [(t_s, ComputeTime(*row(times, k))) for k, t_s in enumerate(times.t_s.tolist())]
    for _, record in sorted(pairs, key=lambda pair: pair[0]):
        yield record
