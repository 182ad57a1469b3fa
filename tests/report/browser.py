"""A headless Chromium at the end of a pipe: what a page asks the network for, and what it complains about.

The DevTools protocol over the file descriptors 3 and 4 (`--remote-debugging-pipe`): messages are JSON, each
with a zero byte behind it.
"""

import json
import os
import select
import shutil
import subprocess
import time
from typing import NamedTuple

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
_FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--remote-debugging-pipe",
)  # fmt: skip


class Visit(NamedTuple):
    """What came of opening a page."""

    requests: list  # URLs asked for, without the page itself and without data: URLs
    complaints: list  # texts of the console's errors and warnings, and of exceptions
    facts: dict  # answers to the questions


def executable():
    """Path of a Chromium, or None."""
    return next((path for path in map(shutil.which, NAMES) if path), None)


def visit(page, profile, questions, width=1280, timeout_s=120.0):
    """Open a page and ask about it.

    Path or address, Path of a profile, {name: JavaScript expression} -> Visit
    """
    to_browser, ours_out = os.pipe()
    ours_in, from_browser = os.pipe()
    command = [
        executable(),
        *_FLAGS,
        f"--user-data-dir={profile}",
        f"--window-size={width},900",
        "about:blank",
    ]
    process = subprocess.Popen(
        ["bash", "-c", f'exec "$@" 3<&{to_browser} 4>&{from_browser}', "bash", *command],
        pass_fds=(to_browser, from_browser),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    os.close(to_browser)
    os.close(from_browser)
    try:
        return _talk(
            _Pipe(ours_out, ours_in, time.monotonic() + timeout_s),
            page if isinstance(page, str) else page.as_uri(),
            questions,
        )
    finally:
        process.terminate()
        process.wait(20)
        os.close(ours_out)
        os.close(ours_in)


class _Pipe:
    """Messages to and from the browser."""

    def __init__(self, out, into, deadline):
        self._out, self._into, self._deadline = out, into, deadline
        self._rest, self._number, self.events = b"", 0, []

    def call(self, method, session=None, **params):
        """Result of a command; what the browser says meanwhile goes to `events`."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params}
        if session:
            message["sessionId"] = session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        return self.wait(lambda answer: answer.get("id") == self._number)

    def wait(self, wanted):
        """The first message that is wanted."""
        while True:
            while b"\0" not in self._rest:
                left = self._deadline - time.monotonic()
                if left <= 0.0 or not select.select([self._into], [], [], left)[0]:
                    raise TimeoutError("the browser does not answer")
                read = os.read(self._into, 1 << 16)
                if not read:
                    raise EOFError("the browser has gone")
                self._rest += read
            raw, _, self._rest = self._rest.partition(b"\0")
            message = json.loads(raw)
            if "method" in message:
                self.events.append(message)
            if wanted(message):
                return message.get("result", message)


def _talk(pipe, url, questions):
    target = pipe.call("Target.createTarget", url="about:blank")["targetId"]
    session = pipe.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
    for domain in ("Page", "Network", "Runtime", "Log"):
        pipe.call(f"{domain}.enable", session)
    pipe.call("Page.navigate", session, url=url)
    pipe.wait(lambda message: message.get("method") == "Page.loadEventFired")
    facts = {}
    for name, expression in questions.items():
        answer = pipe.call(
            "Runtime.evaluate", session, expression=expression, returnByValue=True, awaitPromise=True
        )
        facts[name] = answer["result"].get("value")
    asked, complaints = [], []
    for event in pipe.events:
        params = event["params"]
        if event["method"] == "Network.requestWillBeSent":
            asked.append(params["request"]["url"])
        elif event["method"] == "Log.entryAdded" and params["entry"]["level"] in ("error", "warning"):
            complaints.append(params["entry"]["text"])
        elif event["method"] == "Runtime.consoleAPICalled" and params["type"] in (
            "error",
            "warning",
            "assert",
        ):
            complaints.append(str(params["args"]))
        elif event["method"] == "Runtime.exceptionThrown":
            complaints.append(params["exceptionDetails"]["text"])
    others = [one for one in asked if one != url and not one.startswith("data:") and one != "about:blank"]
    return Visit(others, complaints, facts)
