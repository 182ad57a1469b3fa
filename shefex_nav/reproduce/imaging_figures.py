"""Figures of the experiments on images. Each `draw_*(figure, results, rows)` fills a matplotlib Figure."""

import numpy as np

from shefex_nav.reproduce.imaging import TRACK_CENTROIDS
from shefex_nav.reproduce.picture import COLOURS, tidy


def draw_scan(figure, results, rows):
    """Distribution of the times of both scans."""
    sequential, maximum, _, _ = 1e3 * np.concatenate(results).T
    figure.set_size_inches(7.0, 4.5)
    axis = figure.subplots()
    bins = np.geomspace(0.5 * sequential.min(), 2.0 * maximum.max(), 60)
    axis.hist(sequential, bins, color=COLOURS[0], label="sequential scan")
    axis.hist(maximum, bins, color=COLOURS[1], label="maximum search")
    axis.set_xscale("log")
    axis.set_xlabel("time of a frame [ms]")
    axis.set_ylabel("frames")
    axis.set_title(
        f"ratio {rows[0].measured:.1f}, published {rows[0].published:.1f}", loc="left", fontsize=10
    )
    axis.legend(frameon=False)
    tidy(axis)


def draw_centroids(figure, results, _rows):
    """The first track as in the paper's figure 1: distance from the straight line, image by image."""
    distance = results[0][0]
    images = np.arange(1, distance.shape[1] + 1)
    figure.set_size_inches(10.0, 4.5)
    left, right = figure.subplots(1, 2)
    for m, method in enumerate(TRACK_CENTROIDS):
        name, colour = method.replace("_", " "), COLOURS[m]
        line = np.polyval(np.polyfit(images, distance[m], 1), images)
        left.plot(images, distance[m] - distance[m, 0], lw=1.0, color=colour, label=name)
        right.plot(images, distance[m] - line, "o-", ms=3, lw=0.8, color=colour, label=name)
    left.set_ylabel("change of the distance [px]")
    right.set_ylabel("distance from a straight line [px]")
    for axis in (left, right):
        axis.set_xlabel("image")
        axis.legend(frameon=False, fontsize=9)
        tidy(axis)


def draw_end_to_end(figure, _results, rows):
    """Success with its interval beside the published one."""
    rows = [row for row in rows if row.quantity == "success"]
    figure.set_size_inches(9.0, 4.0)
    axis = figure.subplots()
    for k, row in enumerate(rows):
        low, high = row.ci95 or (row.measured, row.measured)
        axis.plot([100.0 * low, 100.0 * high], [k, k], color=COLOURS[0], lw=2.0)
        axis.plot(100.0 * row.measured, k, "o", color=COLOURS[0])
        if row.published is not None:
            axis.plot(100.0 * row.published, k, "|", ms=18, mew=2.0, color=COLOURS[1])
    axis.set_yticks(range(len(rows)), [row.condition for row in rows], fontsize=9)
    axis.invert_yaxis()
    axis.set_xlabel("success [%]; bar: published as 'more than'")
    tidy(axis)
