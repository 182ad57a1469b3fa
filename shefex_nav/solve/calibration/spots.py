"""Width of the spots of stars: a round Gaussian, integrated over pixels, fitted to each bright one.

The widths scatter by noise, by neighbours, and over the field; their median is the camera's, and its sigma
is that of a median, from the scatter itself.
"""

import numpy as np

REACH_PX = 4  # of the window around a spot
BRIGHTEST = 0.7  # of the brightest grey value in the picture: no slope of the fit is saturated
SIGNIFICANT = 15.0  # of the noise, the peak of a spot that is fitted
MOST = 20  # of a picture
NARROWEST_PX, WIDEST_PX = 0.25, 6.0
FEWEST = 8  # spots in all
MAD, OF_MEDIAN = 1.4826, 1.2533  # normal: sigma over median distance; sigma of a median over that of a mean
# of few widths: MAD is too small and scatters, the error over its sigma is 1.5 with eight and 1.17 with 16
# (8000 drawn sets each); 1 + FEW[0] / (n - FEW[1]) times as large, it is 1
FEW = 2.8, 3.0


def widths(grey, flat, xy_px, noise):
    """Sigma of the Gaussian of each bright spot [px]: (k,).

    grey, flat : (rows, columns) grey values, and without background;  xy_px : (n, 2) stars, brightest first;
    noise : grey values, of a pixel
    """
    found, full = [], BRIGHTEST * float(grey.max())
    for x, y in xy_px:
        column, row = round(float(x)), round(float(y))
        window = slice(row - REACH_PX, row + REACH_PX + 1), slice(column - REACH_PX, column + REACH_PX + 1)
        inside = min(row, column) >= REACH_PX and flat[window].shape == (2 * REACH_PX + 1,) * 2
        if not inside or grey[window].max() > full or flat[row, column] < SIGNIFICANT * noise:
            continue
        width = _width(flat[window].astype(float), x - column, y - row)
        if width is not None:
            found.append(width)
        if len(found) == MOST:
            break
    return np.array(found)


def combined(found):
    """Width of all spots and its sigma [px]; None where too few were fitted. found : (k,) widths"""
    if len(found) < FEWEST:
        return None
    middle, n = float(np.median(found)), len(found)
    sigma = MAD * OF_MEDIAN * np.median(np.abs(found - middle)) / np.sqrt(n)
    return middle, float((1.0 + FEW[0] / (n - FEW[1])) * sigma)


def _width(window, x, y):
    """Sigma [px] of the spot in a window whose middle is 0, 0; None if none fits."""
    from scipy.optimize import least_squares
    from scipy.special import ndtr

    at = np.arange(-REACH_PX, REACH_PX + 1)

    def misfit(p):
        light, x, y, width, sky = p
        along = [ndtr((at + 0.5 - c) / width) - ndtr((at - 0.5 - c) / width) for c in (x, y)]
        return (light * along[1][:, None] * along[0] + sky - window).ravel()

    first = np.array([window.sum(), x, y, 1.0, 0.0])
    low = [0.0, -REACH_PX, -REACH_PX, NARROWEST_PX, -np.inf]
    high = [np.inf, REACH_PX, REACH_PX, WIDEST_PX, np.inf]
    if first[0] <= 0.0:
        return None
    fit = least_squares(misfit, first, bounds=(low, high), x_scale=[first[0], 0.1, 0.1, 0.1, first[0]])
    width = float(fit.x[3])
    return width if fit.success and NARROWEST_PX * 1.01 < width < WIDEST_PX * 0.99 else None
