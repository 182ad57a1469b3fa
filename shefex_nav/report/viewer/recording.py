"""A log as a laid-out rerun recording.

The drawings in the log (pictures, poses, events) are taken from the file as they are; what has to be
computed, the errors against their sigmas above all, comes from the same RunData and functions as the
figures of `metrics`. Other logs are drawn over the first one: their paths and their errors, in colours of
their own.
"""

import errno
import os
import re
import shutil
from itertools import cycle
from pathlib import Path

import numpy as np

from shefex_nav import __version__
from shefex_nav.files import digest, text_of, whole
from shefex_nav.geometry import wgs84
from shefex_nav.log import reader
from shefex_nav.records import Phase, TruthSample
from shefex_nav.report import local_level
from shefex_nav.report.viewer import drawings, layout, legend, navigation, sensors, stars, world
from shefex_nav.report.viewer.program import ViewerError
from shefex_nav.report.viewer.sender import Sender

TIMES_THE_LOG, TIMES_WITHOUT_PICTURES = 1.0, 2.5  # that a recording may have; 0.5 and 2 were seen
APPLICATION = "shefex_nav"
OURS = re.compile(r"(\S+ [0-9a-f]+ \d+)?")  # what a stamp says: program, its digest, time of the log
ENDING = ".view.rrd"  # of the recording kept beside its log
OVERLAY = {
    "orange": (255, 170, 60),
    "violet": (200, 130, 255),
    "turquoise": (90, 230, 210),
    "pink": (255, 120, 170),
    "olive": (200, 200, 90),
}


def read(log):
    """RunData of a log that has something to show; ViewerError otherwise."""
    data = reader.read(log)
    if not len(data.truth.t_s) and not len(data.nav.t_s):
        raise ViewerError(f"{log}: nothing to show, the run ended before its first record")
    return data


def scene(data):
    """A RunData to draw the path of: where there is no truth, that of the navigation stands in for it."""
    if len(data.truth.t_s):
        return data
    nav = data.nav
    unknown = np.full_like(nav.r_i, np.nan)
    phase = np.full(len(nav.t_s), int(Phase.COAST))
    path = TruthSample(
        nav.t_s, phase, nav.r_i, nav.v_i, nav.q_ib, nav.omega_ib_b, unknown, np.full(len(phase), np.nan)
    )
    return data._replace(truth=path)


def kept(log, data=None):
    """Path of the recording of a log, kept beside it and made anew when log or program are others.

    None where the folder cannot be written, and where a file of one of the names is somebody else's.
    """
    path = Path(log).with_suffix(ENDING)
    stamp = path.with_suffix(".version")
    wanted = f"{__version__} {_program()} {os.stat(log).st_mtime_ns}"
    if path.exists() and not stamp.exists():
        return None
    try:
        if stamp.is_symlink() or (stamp.exists() and not OURS.fullmatch(text_of(stamp))):
            return None
        if path.exists() and stamp.exists() and text_of(stamp) == wanted:
            return path
        with whole(path) as half:
            build([log], half, [data] if data else None)
            stamp.write_text("")  # ours, not to be shown before it is finished
        stamp.write_text(wanted)
    except OSError:
        return None
    return path


def _program():
    """Digest of what makes recordings: the source files of `report` and `log`."""
    package = Path(__file__).parents[2]
    return digest([*(package / "report").rglob("*.py"), *(package / "log").glob("*.py")], package)


def build(logs, rrd_path, runs=None, *, page=layout.OVERVIEW):
    """Write the recording of logs to `rrd_path`, laid out with a page of `layout.PAGES` open.

    logs : list of paths, the first is shown whole, the others are drawn over it
    runs : RunData of each, where they have been read
    """
    import rerun as rr

    from shefex_nav.report.viewer import pages

    runs = [read(log) for log in logs] if runs is None else runs
    _check_space(logs, runs, Path(rrd_path))
    first, (own, *others) = runs[0], names(runs, logs)
    stream = rr.RecordingStream(APPLICATION, recording_id=_identifier(first))
    shown = scene(first)
    seen = layout.scene(world.path(shown))
    has = layout.content(shown, drawings.kept_pictures(logs[0]), bool(len(first.truth.t_s)))
    Path(rrd_path).touch()  # rerun's own error has no type
    stream.save(rrd_path, default_blueprint=pages.blueprint(shown, seen, has, page=page))
    fill(stream, logs[0], first)
    sender, words, colours = Sender(stream, first.mission.epoch_utc), [], cycle(OVERLAY.items())
    for name, other in first.others.items():
        word, colour = next(colours)
        beside(sender, first.with_other(name, other), name, colour)
        words.append((name, word))
    for data, name, (word, colour) in zip(runs[1:], others, colours, strict=False):
        overlay(sender, data, first.mission, name, colour)
        words.append((name + _elsewhere(data.mission, first.mission, seen.size), word))
    legend.send(sender, own, words, legend.limit_of(first), has.errors)
    stream.flush()
    stream.disconnect()


def _elsewhere(mission, other, size_m):
    """Words about a flight that starts farther from another than the scene of that one is large."""
    places = (
        wgs84.ecef_from_geodetic(one.launch_latitude, one.launch_longitude, one.launch_height)
        for one in (mission, other)
    )
    away_m = float(np.linalg.norm(np.subtract(*places)))
    return f" (starts {1e-3 * away_m:.0f} km away, out of the scene)" if away_m > size_m else ""


def _check_space(logs, runs, path):
    """OSError where a recording would not fit: rerun waits without end for a disk that is full."""
    times = [TIMES_THE_LOG if len(one.frames.number) else TIMES_WITHOUT_PICTURES for one in runs]
    needed = sum(factor * os.path.getsize(log) for factor, log in zip(times, logs, strict=True))
    free = shutil.disk_usage(path.parent).free
    if free < needed:
        words = f"{os.strerror(errno.ENOSPC)}: {free / 1e6:.3g} MB are free, "
        words += f"a recording may need {needed / 1e6:.3g} MB"
        raise OSError(errno.ENOSPC, words, str(path))


def _identifier(data):
    return f"{data.mission.scenario}-{data.mission.seed}"


def names(runs, logs=()):
    """A name for each of some RunData, by what tells them apart.

    Scenario and seed; where some have them in common, what flew; where that is the same too, the names of the
    files `logs`; where these are alike or not given, scenario and seed with a number.
    """
    identifiers = [_identifier(data) for data in runs]
    by_software = [_flown(data) for data in runs]
    by_file = [re.sub(r"[^\w.]+", "-", Path(log).stem) for log in logs] if len(logs) == len(runs) else []
    for found in (identifiers, by_software, by_file):
        if found and len(set(found)) == len(found):
            return found
    return [name if identifiers.count(name) == 1 else f"{name}-{k + 1}" for k, name in enumerate(identifiers)]


def _flown(data):
    """Software of a RunData in a word that a path of the recording may have."""
    return re.sub(r"[^\w.]+", "-", "-".join(name for _, name, _ in data.mission.software)) or "built-in"


def fill(stream, log_path, data):
    """Send everything of one run to a rerun RecordingStream."""
    stream.send_recording_name(local_level.title(data))
    drawings.send(stream, log_path, data)
    sender, shown = Sender(stream, data.mission.epoch_utc), scene(data)
    if not len(data.truth.t_s):
        _estimate_stands_in(sender)
    world.send(sender, shown)
    world.send_curves(sender, shown)
    sensors.send(sender, data)
    stars.send(sender, data)
    navigation.send(sender, data)
    send_summary(sender, data)


def _estimate_stands_in(sender):
    """Frames of the vehicle and its camera where no truth moves them: those of the estimate."""
    import rerun as rr

    for parent, child in (("body_estimate", "body"), ("body", "star_camera")):
        frame = rr.Transform3D(translation=[0.0, 0.0, 0.0], parent_frame=parent, child_frame=child)
        sender.static(f"frames/{child}", frame)


def overlay(sender, data, mission, name, colour):
    """Draw another run over the first: its path in the first's axes, its errors and sigmas, its NEES."""
    world.send_path(sender, scene(data), mission, f"overlay/{name}", colour)
    beside(sender, data, name, colour)


def beside(sender, data, name, colour):
    """Draw the errors, sigmas and NEES of another run, or solution of the same, beside those of the first."""
    pale = tuple(round(0.55 * c) for c in colour)
    navigation.errors(sender, data, name, (colour, pale))
    navigation.consistency(sender, data, name, colour)


def send_summary(sender, data):
    """The figures of the run as a text."""
    from shefex_nav.report import metrics
    from shefex_nav.report.table import rows

    parts = [f"| {local_level.title(data)} | |", "|---|---|"]
    for section, lines in rows(metrics.summarise(data)):
        parts += [f"| **{section}** | |", *(f"| {name} | {value} |" for name, value in lines)]
    send_text(sender, "\n".join(parts))


def send_text(sender, words):
    """A text, Markdown, in the place of the figures of the run."""
    import rerun as rr

    sender.static("summary", rr.TextDocument(words, media_type=rr.MediaType.MARKDOWN))
