"""The page in a browser on this machine that shows the frames; nobody else can reach it."""

import json
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

PAGE = Path(__file__).with_name("page.html")
HOST = "127.0.0.1"
HOSTS = HOST, "localhost"  # by which it may be called
LONGEST = 10  # digits of a number


def server(player, pace, port=0):
    """A server that shows frames, to be run with serve_forever.

    player : player.Player;  pace : mission time over real time
    port : of this machine, 0: one that is free; the server's `server_address` has it. OSError
    """

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            host = self.headers.get("Host", "").rpartition(":")[0]
            asked = self.path if host in HOSTS else ""  # pages of others may not read the frames
            kind, content = _answer(asked, player, pace)
            self.send_response(HTTPStatus.OK if content else HTTPStatus.NOT_FOUND)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_):
            """Requests are not worth telling."""

    return ThreadingHTTPServer((HOST, port), Handler)


def _answer(path, player, pace):
    """(media type, content) of a path; nothing of one that there is not."""
    times_s = player.times_s()
    if path == "/":
        return "text/html; charset=utf-8", PAGE.read_bytes()
    if path == "/frames.json":
        return "application/json", json.dumps({"times_s": times_s, "pace": pace}).encode()
    number = path.removeprefix("/frame/").removesuffix(".png")
    is_number = number.isascii() and number.isdigit() and len(number) < LONGEST
    if path == f"/frame/{number}.png" and is_number and int(number) < len(times_s):
        return "image/png", player.png(int(number))
    return "text/plain", b""
