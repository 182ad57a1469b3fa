"""One frame of the star camera with what was found in it."""

import numpy as np

from shefex_nav.report.figures import style

_BLACK_SIGMA, _WHITE_SIGMA = 1.0, 18.0  # of the noise: grey values that become black and white
_RING = 12.0  # points, diameter
_NAME_PX = 16.0  # from a star to its name
_LEAST_NOISE = 0.5  # grey values; pictures without the background of the sky have none


@style.styled
def frame(seen):
    """A picture with its objects, the names of the identified stars, and the stars that were not found.

    runs.SeenFrame with pixels -> Figure
    """
    image = seen.image_dn.astype(float)
    middle = np.median(image)
    noise = max(1.4826 * float(np.median(np.abs(image - middle))), _LEAST_NOISE)
    rows, columns = image.shape
    figure, axes = style.single(1.05 + (style.WIDTH - 0.95) * rows / columns, _words(seen))
    axes.grid(False)
    axes.imshow(
        np.sqrt(np.clip((image - middle) / noise - _BLACK_SIGMA, 0.0, None)), cmap="gray", vmin=0.0,
        vmax=np.sqrt(_WHITE_SIGMA - _BLACK_SIGMA), interpolation="none", aspect="equal",
    )  # fmt: skip
    if seen.fix is not None:
        _found(axes, seen.fix)
    if seen.truth is not None:
        _missed(axes, seen)
    axes.set(xlim=(-0.5, columns - 0.5), ylim=(rows - 0.5, -0.5), xlabel="x [px]", ylabel="y [px]")
    axes.legend(
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        markerscale=0.7,
        frameon=False,
        borderaxespad=0.0,
    )
    return figure


def _words(seen):
    """The line above the picture."""
    words = f"Frame {seen.number} at T{seen.t_s:+.2f} s, exposed {1e3 * seen.exposure_s:.0f} ms"
    return words if seen.is_full else f"{words}; background of the sky set to zero"


def _found(axes, fix):
    """Rings around the objects, names beside the identified ones."""
    from shefex_nav.solve.overlay import PROPER_NAMES

    xy_px, named = fix.detections.xy_px, fix.hip > 0
    kinds = (named, style.GREEN, "identified"), (~named, style.ORANGE, "no star of the catalogue")
    for chosen, colour, words in kinds:
        axes.plot(
            *xy_px[chosen].T, "o", mfc="none", mec=colour, ms=_RING, mew=1.5, label=f"{chosen.sum()} {words}"
        )
    for (x, y), hip in zip(xy_px[named], fix.hip[named].tolist(), strict=True):
        up = y > 0.9 * axes.images[0].get_array().shape[0]
        axes.text(
            x, y - _NAME_PX if up else y + _NAME_PX, PROPER_NAMES.get(hip, f"HIP {hip}"), color="#7be3b8",
            fontsize=9, ha="center", va="bottom" if up else "top", clip_on=True,
        )  # fmt: skip


def _missed(axes, seen):
    """Crosses where stars of the truth are that were not identified."""
    known = seen.fix.hip if seen.fix is not None else np.zeros(0)
    lost = ~np.isin(seen.truth.hip, known)
    if lost.any():
        axes.plot(
            *seen.truth.xy_px[lost].T, "+", color=style.SKY, ms=9, mew=1.0,
            label=f"{lost.sum()} true, not identified",
        )  # fmt: skip
