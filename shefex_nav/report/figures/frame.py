"""One frame of the star camera with what was found in it."""

import numpy as np

from shefex_nav.records import Reason
from shefex_nav.report.figures import labels, style

_BLACK_SIGMA, _WHITE_SIGMA = 1.0, 18.0  # of the noise: grey values that become black and white
_STAR_SIGMA = 5.0  # what stands out so far is drawn wider than it is, or a star is a dot that nobody sees
_STAR_PX = 1.2  # by a Gaussian of this sigma
_STAR_DIMMED = 6.0  # over its peak: so a star, of several pixels, is brighter than a hot pixel
_EIGHT_BITS = 255.0
_BRIGHT = 0.25  # of the largest grey value: a sky in which no star is to be seen
_RING = 12.0  # points, diameter
_LEAST_NOISE = 0.5  # grey values; pictures without the background of the sky have none


@style.styled
def frame(seen):
    """A picture with its objects, the names of the identified stars, and the stars that were not found.

    runs.SeenFrame with pixels -> Figure
    """
    rows, columns = seen.image_dn.shape
    figure, axes = style.single(1.05 + (style.WIDTH - 0.95) * rows / columns, _words(seen))
    picture(axes, seen)
    if seen.truth is not None:
        _missed(axes, seen)
    axes.set(xlabel="x [px]", ylabel="y [px]")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        markerscale=0.7,
        frameon=False,
        borderaxespad=0.0,
    )
    return figure


def picture(axes, seen):
    """Draw a SeenFrame with pixels into axes: the sky stretched, its objects ringed, its stars named."""
    rows, columns = seen.image_dn.shape
    axes.grid(False)
    axes.spines[:].set_visible(True)
    shown = _stretched(seen.image_dn.astype(float))
    axes.imshow(shown, cmap="gray", vmin=0.0, vmax=1.0, interpolation="none", aspect="equal")
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5))
    if seen.fix is not None:
        _found(axes, seen.fix)


def _words(seen):
    """The line above the picture."""
    words = f"Frame {seen.number} at T{seen.t_s:+.2f} s, exposed {1e3 * seen.exposure_s:.0f} ms"
    if seen.fix is not None and seen.fix.reason != Reason.NONE:
        words += f"; no attitude: {Reason(seen.fix.reason).name.lower().replace('_', ' ')}"
    return words if seen.is_full else f"{words}; sky background zero"


def _stretched(image):
    """Grey values as brightness from 0 to 1: of a dark sky the stars are seen, a bright one is bright."""
    from scipy.ndimage import gaussian_filter

    middle, full = np.median(image), max(_EIGHT_BITS, image.max())
    if middle > _BRIGHT * full:
        return image / full
    noise = max(1.4826 * float(np.median(np.abs(image - middle))), _LEAST_NOISE)
    sigmas = (image - middle) / noise
    wide = gaussian_filter(np.where(sigmas > _STAR_SIGMA, sigmas, 0.0), _STAR_PX)
    shown = np.maximum(sigmas, 2.0 * np.pi * _STAR_PX**2 / _STAR_DIMMED * wide)
    above = (shown - _BLACK_SIGMA) / (_WHITE_SIGMA - _BLACK_SIGMA)
    return np.sqrt(np.clip(above, 0.0, 1.0))


def _found(axes, fix):
    """Rings around the objects, names beside the identified ones."""
    from shefex_nav.solve.names import name_of

    xy_px, named = fix.detections.xy_px, fix.hip > 0
    kinds = (named, style.GREEN, 1.6, "identified"), (~named, "#8a6a2a", 0.7, "other objects")
    for chosen, colour, width, words in kinds:
        axes.plot(
            *xy_px[chosen].T, "o", mfc="none", mec=colour, ms=_RING, mew=width,
            label=f"{chosen.sum()} {words}",
        )  # fmt: skip
    order = np.flatnonzero(named)  # the brightest first
    names = [name_of(hip) for hip in fix.hip[order].tolist()]
    labels.place(axes, xy_px[order], names, avoid=xy_px, colour="#7be3b8")


def _missed(axes, seen):
    """Crosses where stars of the truth are that were not identified."""
    known = seen.fix.hip if seen.fix is not None else np.zeros(0)
    lost = ~np.isin(seen.truth.hip, known)
    if lost.any():
        axes.plot(
            *seen.truth.xy_px[lost].T, "+", color=style.SKY, ms=9, mew=1.0,
            label=f"{lost.sum()} stars that should be there",
        )  # fmt: skip
