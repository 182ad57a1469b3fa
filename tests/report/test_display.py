"""Frames on the screen of a test bench: angles, light, and the page that shows them."""

import json
import threading
import urllib.error
import urllib.request
from io import BytesIO

import browser
import numpy as np
import pytest
import synthetic_run
from PIL import Image

from shefex_nav.log import pixels, reader
from shefex_nav.log.drawings import FramePolicy
from shefex_nav.log.topics import LogError
from shefex_nav.log.writer import LogWriter
from shefex_nav.report.display import player, server
from shefex_nav.report.display.player import Player

DISPLAY = player.Display(dots=2.0, gamma=2.2, white_dn=255.0)


@pytest.mark.parametrize("offset_px", [1.0, 300.0, 900.0])
def test_dots_are_seen_at_the_angles_of_the_camera(offset_px):
    focal_px, collimator_m, pitch_m = 2200.0, 0.5, 1e-4
    on_screen_m = offset_px * player.dots_per_pixel(focal_px, collimator_m, pitch_m) * pitch_m
    assert np.arctan(on_screen_m / collimator_m) == pytest.approx(np.arctan(offset_px / focal_px), rel=1e-12)


@pytest.mark.parametrize(("gamma", "white_dn"), [(2.2, 255.0), (1.0, 4095.0), (1.8, 1000.0)])
def test_light_is_proportional_to_the_grey_value(gamma, white_dn):
    table = player.codes(player.Display(1.0, gamma, white_dn))
    dn = np.linspace(0.05 * white_dn, white_dn, 40).astype(int)
    light = (table[dn] / 255.0) ** gamma
    assert np.allclose(light, dn / white_dn, atol=gamma / 255.0)
    assert table[0] == 0 and table[int(white_dn)] == 255 and table[65535] == 255


def test_a_spot_keeps_its_place_and_its_light():
    image, table = np.zeros((20, 30), np.uint16), np.arange(65536).clip(0, 255).astype(np.uint8)
    image[8:11, 12:15] = [[20, 60, 20], [60, 200, 60], [20, 60, 20]]
    for dots in (1.0, 2.0, 3.5):
        shown = player.drawn(image, player.Display(dots, 1.0, 255.0), table).astype(float)
        assert shown.shape == (round(20 * dots), round(30 * dots))
        y, x = np.indices(shown.shape) + 0.5  # middles of the dots
        middle = np.array([(shown * axis).sum() / shown.sum() / dots for axis in (x, y)])
        assert middle == pytest.approx([13.5, 9.5], abs=0.02)  # of pixel 13, 9
        assert shown.sum() == pytest.approx(image.sum() * dots**2, rel=0.02)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    options = synthetic_run.Options(start_s=231.0, end_s=236.0)
    path = tmp_path_factory.mktemp("display") / "run.mcap"
    with LogWriter(path, synthetic_run.mission(start_s=231.0), FramePolicy(5, "thresholded", 4.0)) as writer:
        for record in synthetic_run.simulate(options):
            writer.write(record)
    return path


@pytest.fixture
def address(log):
    page = server.server(Player(log, reader.read(log), DISPLAY), pace=1.0)
    threading.Thread(target=page.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{page.server_address[1]}"
    page.shutdown()
    page.server_close()


def got(url):
    with urllib.request.urlopen(url, timeout=20) as answer:
        return answer.read()


def test_the_page_has_the_frames_of_the_log(log, address):
    data, told = reader.read(log), json.loads(got(f"{address}/frames.json"))
    assert np.allclose(told["times_s"], data.frames.t_valid_s)
    kept = [one for one in pixels.between(log) if not one.is_full]
    shown = np.asarray(Image.open(BytesIO(got(f"{address}/frame/7.png"))))
    assert np.array_equal(shown, player.drawn(kept[7].image_dn, DISPLAY, player.codes(DISPLAY)))


@pytest.mark.parametrize(
    "path", ["/frame/999.png", "/frame/-1.png", "/frame/1.png/..", "/../etc/passwd", "/x"]
)
def test_there_is_nothing_else(address, path):
    with pytest.raises(urllib.error.HTTPError, match="404"):
        got(address + path)


def test_pages_of_others_cannot_read_the_frames(address):
    asked = urllib.request.Request(f"{address}/frames.json", headers={"Host": "rebound.example:80"})
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(asked, timeout=20)


@pytest.mark.skipif(browser.executable() is None, reason="no Chromium on this machine")
def test_a_browser_plays_them_dot_by_dot(address, tmp_path):
    wait = "new Promise(done => {{ const look = () => {} ? done({}) : setTimeout(look, 20); look(); }})"
    canvas = "document.getElementById('screen')"
    questions = {
        "later": wait.format(f"+{canvas}.dataset.frame >= 4", f"+{canvas}.dataset.frame"),
        "dots": f"[{canvas}.width, {canvas}.clientWidth * devicePixelRatio]",
        "lit": f"{canvas}.getContext('2d').getImageData(0, 0, {canvas}.width, {canvas}.height)"
        ".data.some((value, k) => k % 4 === 0 && value > 100)",
    }
    seen = browser.visit(f"{address}/", tmp_path, questions)
    assert [one for one in seen.complaints if "favicon" not in one and "404" not in one] == []
    width = 2 * synthetic_run.mission().camera.width_px
    assert seen.facts["dots"] == [width, width]
    assert seen.facts["lit"] is True and seen.facts["later"] >= 4


def test_a_log_without_pixels_is_refused(tmp_path):
    path = tmp_path / "none.mcap"
    with LogWriter(path, synthetic_run.mission(start_s=231.0), FramePolicy(0, "none", 4.0)) as writer:
        for record in synthetic_run.simulate(synthetic_run.Options(start_s=231.0, end_s=233.0)):
            writer.write(record)
    with pytest.raises(LogError, match="keeps no pixels"):
        Player(path, reader.read(path), DISPLAY)


@pytest.mark.parametrize(
    "wrong",
    [
        ("--collimator", "500 mm"),
        ("--collimator", "500 mm", "--dot-pitch", "0 mm"),
        ("--dot-pitch", "0.1 mm", "--collimator", "5 s"),
        ("--gamma", "0"),
        ("--white", "-3"),
        ("--pace", "nan"),
    ],
)
def test_what_cannot_be_shown(command, log, wrong):
    done = command("show", log, *wrong)
    assert done.code == 2 and wrong[-2] in done.err and "Traceback" not in done.err


def test_the_table_says_what_screen_is_wanted(command, log):
    camera = synthetic_run.mission().camera
    dots = 0.5 / (camera.focal_length_px * 1e-4)
    done = command("show", log, "--collimator", "500 mm", "--dot-pitch", "0.1 mm")
    assert done.code == 0
    assert f"{round(camera.width_px * dots)} x {round(camera.height_px * dots)} dots" in done.out
    assert "not true to angle" in command("show", log).out


def test_a_log_has_a_seed_already(command, log):
    done = command("show", log, "--seed", "3")
    assert done.code == 2 and "--seed" in done.err and "a log has its own" in done.err


def test_a_scenario_without_pictures_is_told_by_its_name(command, tmp_path):
    """Its log is a temporary file, which nobody knows."""
    path = tmp_path / "mine.yaml"
    said = (
        "extends: night_sky\nstar_tracker: {enabled: false, on: 0 s, off: 1 s}\nmission: {time_limit: 1 s}\n"
    )
    path.write_text(said)
    done = command("show", str(path))
    assert done.code == 2 and done.err.splitlines()[-1].startswith(f"{path}: keeps no pixels of frames")
