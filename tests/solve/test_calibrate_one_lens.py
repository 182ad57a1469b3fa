"""`calibrate` of pictures of several lenses: refused with their names, and good sets never."""

import re
from pathlib import Path

import numpy as np
import pytest
from calibration_shots import SIZE_PX, YEAR, camera_of, shoot
from PIL import Image
from scipy.stats import chi2
from typer.testing import CliRunner

from shefex_nav.commands.app import app
from shefex_nav.solve.calibration import calibrate, lens_fit, pictures, table
from shefex_nav.solve.header import Taken

TOLD = pictures.Told(15.0, YEAR)
N = 6


@pytest.fixture(scope="module")
def sets():
    """(camera, Seen of N pictures) of drawn cameras, whose lenses are bent and off the middle."""
    drawn = []
    for seed in range(4):
        rng = np.random.default_rng([8118, seed])
        camera = camera_of(rng)
        images = [shoot(rng, camera, background=(2.0, 60.0)[k % 2]) for k in range(N)]
        drawn.append(
            (camera, [pictures.look(f"{k}.png", one, Taken(YEAR), TOLD) for k, one in enumerate(images)])
        )
    return drawn


def zoomed(seen, larger, which):
    """Seen with stars of some pictures further from the middle by a share."""
    middle = 0.5 * (np.array(SIZE_PX) - 1.0)
    return [
        one._replace(sights=one.sights._replace(xy_px=middle + (1.0 + larger) * (one.sights.xy_px - middle)))
        if n in which
        else one
        for n, one in enumerate(seen)
    ]


def told(seen):
    return lens_fit.focal_lengths([one.sights for one in seen], [one.lens for one in seen], SIZE_PX)


def misfit(found):
    """Chi squared of focal lengths about their weighted mean."""
    W = np.linalg.inv(found.covariance)
    d = found.values - (W @ found.values).sum() / W.sum()
    return d @ W @ d


def test_focal_lengths_of_one_lens_scatter_as_their_covariance_says(sets):
    squares = 0.0
    for camera, seen in sets:
        found = told(seen)
        assert (np.abs(found.values - camera.values[0]) < 5.0 * np.sqrt(np.diag(found.covariance))).all()
        assert len(lens_fit.groups(found, untouched=0.0)) == 1
        assert calibrate.check_one_lens(seen) == {}
        squares += misfit(found)
    low, high = chi2.ppf([0.0005, 0.9995], (N - 1) * len(sets))
    assert low < squares < high


def test_few_stars_a_picture_are_not_refused(sets):
    """Five or six stars a picture leave little to tell the noise: some 30 degrees of freedom."""
    rng, alarms = np.random.default_rng(5), 0
    for trial in range(60):
        _, seen = sets[trial % len(sets)]
        few = []
        for one in [*seen, *seen[:2]]:  # two with other stars again
            keep = rng.permutation(len(one.sights.u_i))[: rng.integers(5, 7)]
            sights = lens_fit.Sights(one.sights.C_ci, *(part[keep] for part in one.sights[1:]))
            few.append(one._replace(sights=sights))
        found = told(few)
        assert found.dof < 70.0
        alarms += len(lens_fit.groups(found, untouched=0.0)) > 1
    assert alarms == 0


@pytest.mark.parametrize("which", [{0}, {N - 1}, {1, 2, 4}])
@pytest.mark.parametrize("larger", [-0.003, 0.003, 0.05])
def test_pictures_of_another_zoom_are_named(sets, which, larger):
    for camera, seen in sets:
        found = told(zoomed(seen, larger, which))
        groups = lens_fit.groups(found)
        parts = [set(one.members.tolist()) for one in groups]
        expected = [set(range(N)) - which, which]
        assert parts == (expected if larger > 0.0 else expected[::-1])
        for one, part in zip(groups, parts, strict=True):
            true = camera.values[0] * (1.0 + larger * (part == which))
            assert abs(one.focal_px - true) < 4.0 * one.sigma_px < 0.005 * true


def test_another_zoom_does_not_make_the_noise_larger(sets):
    for _, seen in sets:
        good, mixed = told(seen), told(zoomed(seen, 0.01, {0, 1, 2}))
        ratio = np.sqrt(np.diag(mixed.covariance) / np.diag(good.covariance))
        assert (np.abs(ratio - 1.0) < 0.1).all()
        assert mixed.dof == pytest.approx(good.dof, abs=4.0)  # no star is taken for a wrong one


def test_what_air_and_heat_do_is_noted_and_not_refused(sets):
    for _, seen in sets:
        touched = zoomed(seen, 0.001, {0, 1, 2})
        found = calibrate.of_seen(touched)
        percent = re.search(r"scatters by ([0-9.]+) %, more than their stars", found.notes["focal_length_px"])
        assert float(percent[1]) == pytest.approx(0.05, abs=0.011)  # half of them by 0.1 %
        assert table.as_numbers(found)["notes"] == found.notes
        assert calibrate.of_seen(seen).notes == {}


def test_one_picture_has_one_lens(sets):
    most = max((one for _, seen in sets for one in seen), key=lambda one: len(one.sights.u_i))
    assert calibrate.check_one_lens([most]) == {}


def test_residuals_beyond_those_of_centroids_are_noted(sets):
    _, seen = sets[0]
    rng = np.random.default_rng(9)
    rough = [
        one._replace(
            sights=one.sights._replace(xy_px=one.sights.xy_px + rng.normal(0.0, 1.0, one.sights.xy_px.shape))
        )
        for one in seen
    ]
    found = calibrate.of_seen(rough)
    assert "more than 0.8 px" in found.notes["residual_px"]  # the width of a spot
    assert calibrate._residual_note(0.49, (0.3, 0.01)) == calibrate._residual_note(0.49, None) == {}
    assert "0.5 px" in calibrate._residual_note(0.51, (0.3, 0.01))["residual_px"]
    assert calibrate._residual_note(1.4, (1.5, 0.01)) == {}


def test_pictures_of_two_cameras_are_refused_and_nothing_is_written(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(41)
    camera = camera_of(rng)
    values = camera.values.copy()
    values[0] *= 1.01
    for name, one in (("a", camera), ("b", camera._replace(values=values))):
        for k in range(2):
            Image.fromarray(shoot(rng, one)).save(f"{name}{k}.png")
    words = ["calibrate", "a0.png", "b0.png", "a1.png", "b1.png", "--camera", "shefex2_andoya"]
    result = CliRunner().invoke(app, [*words, "--epoch", str(YEAR), "--output", "mixed.yaml"])
    assert result.exit_code == 2, result.output
    said = " ".join(result.output.split())
    assert f"a0.png, a1.png: {camera.values[0]:.0f}"[:-1] in said
    assert f"b0.png, b1.png: {values[0]:.0f}"[:-1] in said
    assert "they are not of one camera, its zoom or focus was touched, or it turned" in said
    assert not Path("mixed.yaml").exists()
