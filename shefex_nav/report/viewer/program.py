"""Runs the rerun viewer: on a screen, or without one for a picture and for what its views complain about."""

import os
import re
import shutil
import socket
import subprocess
import sys
import sysconfig
import tempfile
import time
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from pathlib import Path

from shefex_nav.errors import UserError

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")  # of Linux; one of them names a screen
INSTEAD = "save a recording (--save) or a picture (--screenshot), or show it in a browser (--web)"
FOLLOWED = "`shefex-nav view LOG --follow --web` shows it in a browser"  # of a log that is being written
SETTLE_S = 1.0  # for so long a picture must not have changed,
SETTLE_PICTURES = 3  # nor while so many are taken: on a busy machine each takes longer
PAUSE_S = 0.2  # between two
MOST_PICTURES = 60
_LOAD_TIMEOUT_S = 120.0


class ViewerError(UserError):
    """The viewer cannot be used; the message says why and is for people."""


def path():
    """Path of the rerun viewer that belongs to this Python.

    If it can be, that of the program itself: the script of the same name would start it from a Python of its
    own, which takes time, and leave it open when that is ended.
    """
    name = "rerun.exe" if os.name == "nt" else "rerun"
    folders = [Path(sysconfig.get_path("scripts")), Path(sys.executable).parent]
    package = find_spec("rerun_cli")
    if package is not None and sys.platform != "darwin" and "RERUN_CLI_PATH" not in os.environ:
        folders[:0] = map(Path, package.submodule_search_locations)
    for candidate in (folder / name for folder in folders):
        if candidate.exists():
            return candidate
    found = shutil.which(name)
    if found is None:
        raise ViewerError("the rerun viewer is not installed: pip install rerun-sdk")
    return Path(found)


def show(recording):
    """Open a recording in the viewer and wait until it is closed."""
    _check_screen(os.environ, INSTEAD)
    failed = _failed([str(recording), "--port", "auto"])
    if failed:
        words = f"the viewer could not open a window: {failed}"
        raise ViewerError(f"{words}\nOn a machine without a screen, {INSTEAD}.")


def _failed(options):
    """Run the viewer to its end: why it failed, '' if it did not."""
    told = {"RUST_LOG": "error", **os.environ}
    done = subprocess.run([str(path()), *options], env=told, stderr=subprocess.PIPE, text=True, check=False)
    return _reason(done.stderr, done.returncode) if done.returncode else ""


def _check_screen(environment, instead):
    """ViewerError where there is no screen; without it the viewer names a line of a library of its own.

    instead : words about what can be done without one
    """
    if sys.platform == "linux" and not any(environment.get(name) for name in SCREENS):
        raise ViewerError(
            "the viewer could not open a window: this machine has no screen (neither DISPLAY nor "
            f"WAYLAND_DISPLAY is set); {instead}"
        )


class Window:
    """A viewer that waits for what is sent to it, once it listens.

    with Window() as window:
        window.wait_until_it_listens()
        stream.connect_grpc(window.url)

    web : serve it to a browser on this machine, and say where
    environment : of the viewer, dict; None: that of this process
    """

    def __init__(self, web=False, environment=None):
        environment = os.environ if environment is None else environment
        if not web:
            _check_screen(environment, FOLLOWED)
        self._port = port = _free_port()
        self.url = f"rerun+http://127.0.0.1:{port}/proxy"
        self._web, self._said = web, tempfile.TemporaryFile("w+")
        options = _to_browsers(port) if web else ["--hide-welcome-screen", "--expect-data-soon"]
        command = [str(path()), "--bind", "127.0.0.1", "--port", str(port), *options]
        told = {"RUST_LOG": "error", **environment}
        self._process = subprocess.Popen(command, env=told, stderr=self._said)

    def is_open(self, within_s=0.0):
        """Whether it is still there after a while; ViewerError if it could not be opened."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(within_s)
        code = self._process.poll()
        if code:
            self._said.seek(0)
            words = "could not be served" if self._web else "could not open a window"
            raise ViewerError(f"the viewer {words}: {_reason(self._said.read(), code)}")
        return code is None

    def wait(self):
        """Until it is closed."""
        self._process.wait()
        self.is_open()

    def wait_until_it_listens(self):
        """Wait; ViewerError if it could not be opened."""
        while self.is_open() and not self._listens():
            time.sleep(0.02)

    def __enter__(self):
        return self

    def _listens(self):
        """Whether it takes what is sent to it."""
        with socket.socket() as probe:
            return probe.connect_ex(("127.0.0.1", self._port)) == 0

    def __exit__(self, *exc_info):
        self._process.terminate()
        self._said.close()


def serve(recording):
    """Serve a recording to browsers on this machine until interrupted; says where."""
    port = _free_port()
    failed = _failed(["--bind", "127.0.0.1", "--port", str(port), *_to_browsers(port), str(recording)])
    if failed:
        raise ViewerError(f"the viewer could not be served: {failed}")


def _to_browsers(port):
    """Options of a viewer that listens at a port and serves itself to browsers; says where."""
    page = _free_port()
    url = f"http://127.0.0.1:{page}/?url=rerun%2Bhttp://127.0.0.1:{port}/proxy"
    print(f"open {url} in a browser; Ctrl-C ends it", file=sys.stderr)
    return ["--serve-web", "--web-viewer-port", str(page)]


def take_picture(recording, picture, at_s):
    """Save what the viewer shows of a recording at a mission time; returns the reports of its views.

    recording: .rrd file, picture: .png file (1920 x 1080). The reports are [(view name, [text, ...])],
    empty lists where nothing is wrong.
    """
    from rerun.experimental import ViewerClient

    from shefex_nav.report.viewer.sender import TIMELINE

    program = path()
    picture = Path(picture).absolute()
    if not picture.parent.is_dir():
        raise ViewerError(f"{picture}: no folder {picture.parent}")
    with _without_screen():
        try:
            client = ViewerClient.spawn(
                headless=True, port=_free_port(), hide_welcome_screen=True, executable_path=str(program)
            )
        except Exception as error:
            raise ViewerError(_no_graphics(error)) from error
        with client:
            try:
                _open(client, Path(recording).absolute())
                client.set_time(TIMELINE, duration=float(at_s), play_state="paused")
                _save_settled(client, picture)
                views = client.get_state().views
            except (RuntimeError, ConnectionError, TimeoutError) as error:
                raise ViewerError(_no_graphics(error)) from error
    if not picture.exists():
        raise ViewerError(f"{picture}: the viewer saved no picture")
    return [(view.name, [str(report) for report in view.reports]) for view in views]


def quieten(level="error"):
    """Let rerun in this process tell errors alone, or nothing: that a log was cut off is told by us.

    Its reader takes up what RUST_LOG says when it is imported; whoever has set that gets what was asked for.
    """
    if "RUST_LOG" in os.environ or "rerun" in sys.modules:
        return
    os.environ["RUST_LOG"] = level
    try:
        import rerun  # noqa: F401
    finally:
        del os.environ["RUST_LOG"]


@contextmanager
def _without_screen():
    """What the viewer wants to find in the environment, while it is wanted; it is talkative otherwise."""
    before = dict(os.environ)
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("XDG_RUNTIME_DIR", folder)
        os.environ.setdefault("RUST_LOG", "error")
        try:
            yield
        finally:
            for name in ("XDG_RUNTIME_DIR", "RUST_LOG"):
                if name not in before:
                    del os.environ[name]


def _open(client, recording):
    client.open([str(recording)])
    deadline = time.monotonic() + _LOAD_TIMEOUT_S
    while client.get_state().loading:
        if time.monotonic() > deadline:
            raise ViewerError(f"{recording}: the viewer did not finish loading in {_LOAD_TIMEOUT_S:.0f} s")
        time.sleep(0.1)


def _save_settled(client, picture):
    """Save a picture that no longer changes: data may come in after the loading is over."""
    before, since_s, same = None, time.monotonic(), 0
    for _ in range(MOST_PICTURES):
        begin_s = time.monotonic()
        client.save_screenshot(str(picture))
        now = picture.read_bytes() if picture.exists() else None
        if now is None or now != before:
            before, since_s, same = now, begin_s, 0
        else:
            same += 1
        if same >= SETTLE_PICTURES and time.monotonic() - since_s >= SETTLE_S:
            return
        time.sleep(PAUSE_S)


def _reason(said, code):
    """The last line of what a program said, or how it ended; without places in its source."""
    last = (said.strip().splitlines() or [f"exit code {code}"])[-1]
    return re.sub(r"\b(?:os error )?at /\S+\.rs:\d+(?::\d+)?: ", "", last)


def _free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def _no_graphics(error):
    return (
        f"the viewer cannot draw without a screen: {error}\n"
        "It needs a Vulkan driver; in software on Debian or Ubuntu: "
        "apt-get install mesa-vulkan-drivers libvulkan1 libgl1-mesa-dri"
    )
