"""The picture of a frame: what is drawn wide, what is only counted, and what is said of it."""

from types import SimpleNamespace

import numpy as np
import pytest

from shefex_nav.records import Detections, Reason
from shefex_nav.report.figures import frame
from shefex_nav.runs.frames import SeenFrame

STAR_XY, HOT_XY, FAINT_XY = (30, 40), (70, 20), (50.0, 60.0)


def seen(image_dn, *, is_full, reason=Reason.NONE, t_s=300.025):
    xy_px = np.array([STAR_XY, FAINT_XY], float)
    ones = np.ones(2, int)
    found = Detections(xy_px, np.array([900.0, 60.0]), 9 * ones, 0 * ones, np.tile(np.eye(2), (2, 1, 1)))
    fix = SimpleNamespace(detections=found, hip=np.zeros(2, int), reason=reason)
    return SeenFrame(660, t_s, 0.05, 0.0, image_dn, is_full, fix, None)


@pytest.fixture
def cut_off():
    """A frame of which the log kept a star of nine pixels and a hot pixel, and of a faint object nothing."""
    image = np.zeros((80, 100), np.uint8)
    x, y = STAR_XY
    image[y - 1 : y + 2, x - 1 : x + 2] = 90
    image[y, x] = 200
    image[HOT_XY[1], HOT_XY[0]] = 255
    return image


def words(figure):
    """All that is written over, in and below the picture."""
    axes = figure.axes[0]
    return " | ".join(one.get_text() for one in [*figure.texts, *axes.get_legend().get_texts(), *axes.texts])


def test_a_hot_pixel_stays_a_pixel_and_a_star_is_drawn_wide(cut_off):
    drawn = np.asarray(frame.frame(seen(cut_off, is_full=False)).axes[0].images[0].get_array())
    around = np.argwhere(drawn > 0.0)
    is_hot = np.hypot(around[:, 1] - HOT_XY[0], around[:, 0] - HOT_XY[1]) < 10.0
    assert is_hot.sum() == 1
    assert (~is_hot).sum() > 2 * 9


def test_pixels_of_no_object_are_counted_and_the_cut_is_said(cut_off):
    said = words(frame.frame(seen(cut_off, is_full=False)))
    assert "Frame 660 at T+300.025 s, exposed 50 ms" in said
    assert "1 single pixels: hot, or noise" in said
    assert "the log keeps only the pixels that stand out" in said and "A ring around black" in said


def test_a_single_pixel_of_an_object_is_not_counted(cut_off):
    cut_off[HOT_XY[1], HOT_XY[0]] = 0
    cut_off[round(FAINT_XY[1]), round(FAINT_XY[0]) + 1] = 30  # what is left of the faint object
    assert "single pixels" not in words(frame.frame(seen(cut_off, is_full=False)))


def test_a_whole_frame_says_nothing_of_a_cut():
    image = np.random.default_rng(1).normal(20.0, 2.0, (80, 100)).astype(np.uint8)
    assert "the log keeps only" not in words(frame.frame(seen(image, is_full=True)))


@pytest.mark.parametrize("is_full", [True, False])
def test_a_white_picture_says_how_bright_it_is(is_full):
    image = np.full((80, 100), 255, np.uint8)
    image[:8] = 254
    said = words(frame.frame(seen(image, is_full=is_full, reason=Reason.SATURATED)))
    assert "no attitude: saturated" in said
    assert "bright all over: median grey value 255, 90 % at 255" in said
    assert "the log keeps only" not in said and "single pixels" not in said
