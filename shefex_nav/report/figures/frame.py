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
_NEAR_PX = 2.0  # so far around an object its pixels lie
_CUT_OFF = (
    "Of this frame the log keeps only the pixels that stand out (log.frames of the scenario); the others are "
    "black.\nA ring around black is an object each of whose pixels is too faint for that: only their sum "
    "stands out."
)


@style.styled
def frame(seen):
    """A picture with its objects, the names of the identified stars, and the stars that were not found.

    runs.SeenFrame with pixels -> Figure
    """
    rows, columns = seen.image_dn.shape
    is_cut_off = not seen.is_full and not _is_bright(seen.image_dn)
    below = 0.45 if is_cut_off else 0.0
    figure, axes = style.single(1.05 + (style.WIDTH - 0.95) * rows / columns, _words(seen), below)
    picture(axes, seen)
    if seen.truth is not None:
        _missed(axes, seen)
    _single_pixels(axes, seen)
    _brightness(axes, seen.image_dn)
    axes.set(xlabel="x [px]", ylabel="y [px]")
    if is_cut_off:
        figure.text(0.01, 0.01, _CUT_OFF, ha="left", va="bottom", fontsize=9, color=style.GREY)
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=4,
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
    words = f"Frame {seen.number} at T{seen.t_s:+.3f} s, exposed {1e3 * seen.exposure_s:.0f} ms"
    if seen.fix is not None and seen.fix.reason != Reason.NONE:
        words += f"; no attitude: {Reason(seen.fix.reason).name.lower().replace('_', ' ')}"
    return words


def _stretched(image):
    """Grey values as brightness from 0 to 1: of a dark sky the stars are seen, a bright one is bright."""
    from scipy.ndimage import gaussian_filter

    if _is_bright(image):
        return image / _full(image)
    sigmas = _sigmas(image)
    above = sigmas > _STAR_SIGMA
    wide = gaussian_filter(np.where(above & ~_alone(above), sigmas, 0.0), _STAR_PX)
    shown = np.maximum(sigmas, 2.0 * np.pi * _STAR_PX**2 / _STAR_DIMMED * wide)
    above = (shown - _BLACK_SIGMA) / (_WHITE_SIGMA - _BLACK_SIGMA)
    return np.sqrt(np.clip(above, 0.0, 1.0))


def _full(image):
    """The largest grey value that there may be."""
    return max(_EIGHT_BITS, float(image.max()))


def _is_bright(image):
    """Whether no star is to be seen for the light of the sky."""
    return float(np.median(image)) > _BRIGHT * _full(image)


def _sigmas(image):
    """How far each pixel is above the sky, in standard deviations of its noise: (rows, columns)."""
    middle = np.median(image)
    noise = max(1.4826 * float(np.median(np.abs(image - middle))), _LEAST_NOISE)
    return (image - middle) / noise


def _alone(above):
    """Pixels without another above among the eight around them, as no lens makes: (rows, columns) bool."""
    from scipy.ndimage import convolve

    return above & (convolve(above.astype(np.uint8), np.ones((3, 3), np.uint8), mode="constant") == 1)


def _single_pixels(axes, seen):
    """Say in the legend how many single pixels stand out that belong to no object."""
    image = seen.image_dn.astype(float)
    if _is_bright(image):
        return
    y, x = np.nonzero(_alone(_sigmas(image) > _STAR_SIGMA))
    objects = seen.fix.detections.xy_px if seen.fix is not None else np.zeros((0, 2))
    away = np.hypot(x[:, None] - objects[:, 0], y[:, None] - objects[:, 1])
    count = int((away.min(axis=1, initial=np.inf) > _NEAR_PX).sum())
    if count:
        label = f"{count} single pixels: hot, or noise"
        axes.plot([], [], "s", color=style.GREY, ms=3, label=label)


def _brightness(axes, image):
    """Write into a picture that is bright all over how bright it is."""
    image = image.astype(float)
    if not _is_bright(image):
        return
    full = _full(image)
    words = f"median grey value {np.median(image):.0f}, {100.0 * np.mean(image >= full):.0f} % at {full:.0f}"
    axes.text(
        0.5, 0.5, f"bright all over: {words}", transform=axes.transAxes, ha="center",
        bbox={"facecolor": "white", "edgecolor": style.GREY},
    )  # fmt: skip


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
