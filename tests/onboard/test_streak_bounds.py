"""Rate-aided detection at any rate: it ends, within its arrays, with a result or with none."""

import os
import subprocess
import sys

import numpy as np
import pytest
from scipy.stats import poisson
from streak_fields import DEG, IMPA, SHEFEX, add_star, dark, detect_params, digitise, match

from shefex_nav.geometry.shutter import row_times
from shefex_nav.onboard.startracker.streaks import Motion, detect_near, detect_streaks

RATES = (0.0, 20.0, 60.0, 134.0, 190.0, 400.0)  # deg/s
AXES = ((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 1.0), (0.6, 0.8, 0.0), (-0.5, 0.3, 0.8))
LINES = (0.0, 1e-4, 3e-4)  # s


def shown(bench, rng, what):
    """A frame of noise, of crowded light, or of one grey value."""
    light = dark(bench)
    if what == "light":
        for _ in range(50):
            x, y, angle = rng.uniform([0.0, 0.0, 0.0], [*light.shape[::-1], 2.0 * np.pi])
            step = np.arange(rng.integers(1, 300))
            r, c = (y + step * np.sin(angle)).astype(int), (x + step * np.cos(angle)).astype(int)
            inside = (r >= 0) & (r < light.shape[0]) & (c >= 0) & (c < light.shape[1])
            light[r[inside], c[inside]] += 10.0 ** rng.uniform(2.0, 5.0)
    image = digitise(bench, light, rng)
    return np.full_like(image, bench.saturation_dn // 2) if what == "flat" else image


def is_sound(found):
    return np.isfinite(found.xy_px).all() and (np.linalg.eigvalsh(found.P_px) > 0.0).all()


@pytest.mark.parametrize("bench", [SHEFEX, IMPA], ids=["shefex", "impa"])
@pytest.mark.parametrize("what", ["noise", "light", "flat"])
def test_any_rate_ends(bench, what):
    """In noise there are no more objects than the half a frame that is allowed; a flat frame shows none."""
    rng, params = np.random.default_rng(31), detect_params(bench)
    image, n, frames = shown(bench, rng, what), 0, 0
    places = rng.uniform(
        [-20.0, -20.0], [bench.camera.width_px + 20.0, bench.camera.height_px + 20.0], (20, 2)
    )
    for rate in RATES:
        for axis in AXES:
            for line_s in LINES:
                times = row_times(bench.exposure_s * rng.choice([0.2, 1.0]), line_s, bench.camera.height_px)
                omega_c = rate * DEG * np.array(axis) / np.linalg.norm(axis)
                motion = Motion(omega_c, (0.01 * DEG) ** 2 * np.eye(3), times)
                found, statistics = detect_streaks(params, bench.model, image, motion)
                P_px = np.tile(10.0 ** rng.uniform(-2.0, 4.0) * np.eye(2), (len(places), 1, 1))
                near, _ = detect_near(params, bench.model, image, motion, places, P_px)
                assert is_sound(found)
                assert is_sound(near)
                assert np.isfinite(statistics).all()
                n, frames = n + len(found.flux_dn), frames + 1
    if what == "noise":
        assert n <= poisson.ppf(0.999, 0.5 * frames)
    if what == "flat":
        assert n == 0


@pytest.mark.parametrize("direction, least, most", [(1.0, 0, 0), (-1.0, 20, 30)])
def test_at_134_deg_per_s_with_the_rows_there_is_nothing_and_against_them_stars(direction, least, most):
    """f omega is 5900 px/s, the rows open at 10000 px/s: with them a star is seen 1 / (1 - 0.59) as long, and
    its streak is 590 px, longer than the frame is high; against them it is 150 px."""
    rng, times = np.random.default_rng(32), row_times(0.041, 1e-4, 493)
    omega_c, light = np.array([direction * 134.0 * DEG, 0.0, 0.0]), dark(SHEFEX)
    places = rng.uniform([50.0, 50.0], [609.0, 443.0], (30, 2))
    for x, y in places:
        add_star(light, SHEFEX, times, omega_c, x, y, 3e5, step_px=0.5)
    image = digitise(SHEFEX, light, rng)
    found, _ = detect_streaks(detect_params(SHEFEX), SHEFEX.model, image, Motion(omega_c, None, times))
    k = match(found.xy_px, places, 1.5)
    assert least <= (k >= 0).sum() <= len(found.flux_dn) <= most


@pytest.mark.slow
def test_no_index_leaves_its_array(tmp_path):
    """The tests above once more, with every index of the kernels checked."""
    environment = dict(os.environ, NUMBA_BOUNDSCHECK="1", NUMBA_CACHE_DIR=str(tmp_path))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-m", "not slow", __file__]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=900, check=False)
    assert run.returncode == 0, run.stdout[-3000:]
