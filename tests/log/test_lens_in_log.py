"""The distortion of the camera in a log: read back, told to viewers, drawn around the field."""

import json

import numpy as np
from mcap.reader import make_reader

from shefex_nav import runs
from shefex_nav.log import reader
from shefex_nav.report.figures import sky
from shefex_nav.scenario import load

K = (-0.376, 0.0, 0.001, 0.0, 0.0)


def test_log_says_the_lens(tmp_path):
    path = tmp_path / "bent.mcap"
    scenario = load.load("night_sky", [f"star_camera.optics.distortion={list(K)}"])
    runs.fly(scenario, 1, until_s=1.2, log=path)
    mission = reader.read(path).mission
    assert mission.distortion == K
    border = sky._border(mission)
    plain = sky._border(mission._replace(distortion=()))
    assert len(border) > len(plain) == 5
    # the barrel shows more sky: its corners look further from the axis, by 1 % of their distance
    assert border[:, 2].min() < plain[:, 2].min()
    x, y = border[0, :2] / border[0, 2]
    hole, r2 = mission.camera, x * x + y * y
    seen = x * (1 + K[0] * r2) + 2 * K[2] * x * y, y * (1 + K[0] * r2) + K[2] * (r2 + 2 * y * y)
    np.testing.assert_allclose(
        hole.focal_length_px * np.array(seen) + [hole.cx_px, hole.cy_px], [-0.5, -0.5], atol=1e-6
    )
    with path.open("rb") as file:
        said = [
            one for _, channel, one in make_reader(file).iter_messages(topics=["/star_tracker/calibration"])
        ]
    assert len(said) == 1
    assert b"plumb_bob" in said[0].data
    assert np.array(K).tobytes() in said[0].data
    with path.open("rb") as file:
        metadata = list(make_reader(file).iter_metadata())
    assert any(json.loads(one.metadata.get("distortion", "[]")) == list(K) for one in metadata)
