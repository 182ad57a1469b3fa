"""Logs in the rerun viewer: opened on a screen, served to a browser, saved, or taken a picture of."""

import os
import tempfile
from contextlib import contextmanager, suppress
from pathlib import Path
from threading import Thread

from shefex_nav.report.viewer import layout, program
from shefex_nav.report.viewer.program import ViewerError

__all__ = ["ViewerError", "follow", "view"]


def view(logs, *, save=None, screenshot=None, at_s=None, page=layout.OVERVIEW, web=False):
    """Open logs in the viewer and wait until it is closed, or save their recording, or a picture.

    Parameters
    ----------
    logs : .mcap file, or a list of them; the first is shown whole, the others are drawn over it
    save, screenshot : .rrd and .png files to write
    at_s : s, mission time of the picture, by default the middle of the star fixes
    page : of `layout.PAGES`, open at first
    web : serve it to a browser on this machine

    Returns
    -------
    list of RunData; their `ended_early` and `last_t_s` are worth telling
    """
    from shefex_nav.report.viewer import recording

    program.quieten()
    logs = [logs] if isinstance(logs, str | Path) else list(logs)
    runs = [recording.read(log) for log in logs]
    if screenshot is not None:
        at_s = layout.start_time(recording.scene(runs[0])) if at_s is None else at_s
        _check_time(logs[0], runs[0], at_s)
    if save is not None:
        recording.build(logs, save, runs, page=page)
    if screenshot is not None:
        with _temporary(logs, runs, page) as path:
            reports = program.take_picture(path, screenshot, at_s)
        bad = [f"{view}: {text}" for view, texts in reports for text in texts]
        if bad:
            raise ViewerError(f"{logs[0]}: views in error: " + "; ".join(bad))
    if save is None and screenshot is None:
        show = program.serve if web else program.show
        beside = recording.kept(logs[0], runs[0]) if len(logs) == 1 and page == layout.OVERVIEW else None
        if beside is not None:
            show(beside)
        else:
            with _temporary(logs, runs, page) as path:
                show(path)
    return runs


def _import_what_shows():
    """Import what `follow` is going to use. What cannot be imported is told when it is used."""
    with suppress(Exception):
        program.quieten("off")  # a viewer that has been closed is no error
        import mcap.stream_reader  # noqa: F401
        import pyarrow.compute  # noqa: F401 both for the first slice of the log

        from shefex_nav.report.viewer import live, pages, recording  # noqa: F401


def follow(named, *, page=layout.OVERVIEW, web=False):
    """Show a log in the viewer while it is written, and wait until the viewer is closed.

    Parameters
    ----------
    named : function that waits for the path of the .mcap file, which need not be there yet, and gives it with
        the `old_ns` of `tail.Tail`; or None, then nothing is opened. Meanwhile is imported what shows it
    page : of `layout.PAGES`, open at first
    web : serve it to a browser on this machine
    """
    environment = dict(os.environ)  # as it is without what `quieten` needs meanwhile
    importing = Thread(target=_import_what_shows)
    importing.start()
    try:
        if (found := named()) is not None:
            with program.Window(web, environment) as window:
                importing.join()
                _send(window, *found, page)
    finally:
        importing.join()  # what is imported half cannot be left


def _send(window, log, old_ns, page):
    """Show a log in a program.Window while it is written; as `follow`."""
    import rerun as rr

    from shefex_nav.report.viewer import live, recording

    window.wait_until_it_listens()
    stream = rr.RecordingStream(recording.APPLICATION)
    stream.connect_grpc(window.url)
    try:
        live.wait_for(log, stream)
        live.follow(log, stream, page=page, old_ns=old_ns, is_wanted=window.is_open)
    except RuntimeError:  # the SDK's, when nobody takes what it sends
        if window.is_open(within_s=2.0):
            raise
    window.wait()


@contextmanager
def _temporary(logs, runs, page):
    """A recording that is deleted afterwards."""
    from shefex_nav.report.viewer import recording

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "view.rrd"
        recording.build(logs, path, runs, page=page)
        yield path


def _check_time(log, data, at_s):
    from shefex_nav.report.viewer import world

    first_s, last_s = world.time_span(data)
    if not first_s <= at_s <= last_s:
        raise ViewerError(f"{log}: covers {first_s:g} s to {last_s:g} s, not {at_s:g} s")
