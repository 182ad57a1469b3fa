"""What the pictures of a camera tell about it, all together."""

from typing import NamedTuple

import numpy as np

from shefex_nav.errors import UserError
from shefex_nav.solve.calibration import hot_pixels, lens_fit, noise, pictures, spots
from shefex_nav.solve.calibration.pictures import Unsolved

FEWEST_STARS = 40  # named, in all pictures: fewer leave a lens of eight parameters to its prior
LOOSEST = 0.01  # of the focal length: a larger sigma is no calibration
# RMS of the stars, of the width of a spot: noise makes a fifth of it of the faintest star that is detected
WORST, WORST_PX = 1.0, 0.5  # and a spot within one pixel has such errors, whatever its width


class CalibrationError(UserError):
    """Pictures that do not go together; the message says which."""


class Known(NamedTuple):
    """What somebody says of the detector; None where nobody does."""

    black_dn: float | None = None
    electrons_per_dn: float | None = None


class Calibration(NamedTuple):
    """A camera as its pictures show it; None where they do not."""

    size_px: tuple  # (width, height)
    lens: lens_fit.LensFit
    n_stars: int  # that made the lens
    pictures: list  # names of those that are solved
    unsolved: list  # of Unsolved
    psf_sigma: tuple | None  # (value, sigma) [px]
    noise: noise.Noise | None
    hot: hot_pixels.HotPixels
    why: dict  # name -> words, of what is not told
    notes: dict  # name -> words, of what is told and should not be believed as it stands
    apart: float  # rad, largest angle between the axes of two pictures


def of_seen(seen, known=Known()):  # noqa: B008 a NamedTuple does not change
    """Calibration of looked-at pictures, or words that say why there is none.

    seen : list of Seen or Unsolved;  known : Known
    """
    unsolved = [one for one in seen if isinstance(one, Unsolved)]
    seen = [one for one in seen if not isinstance(one, Unsolved)]
    if not seen:
        return f"none of the {len(unsolved)} pictures is solved: {', '.join(map(_named, unsolved))}"
    check_together(seen)
    size_px, n_named = seen[0].size_px, sum(len(one.sights.u_i) for one in seen)
    if n_named < FEWEST_STARS:
        return (
            f"{n_named} stars are named in {len(seen)} solved pictures; a lens needs {FEWEST_STARS}: "
            "give more pictures, or such with more stars"
        )
    first = seen[int(np.argmax([len(one.sights.u_i) for one in seen]))].lens
    notes = check_one_lens(seen)
    lens = lens_fit.fit([one.sights for one in seen], first, size_px)
    share = lens.sigma[0] / lens.values[0]
    if not share < LOOSEST:
        return f"the stars tell the focal length to {100.0 * share:.2g} % only; give more pictures"
    why = {}
    psf = spots.combined(np.concatenate([one.widths_px for one in seen]))
    if psf is None:
        why["psf_sigma"] = f"fewer than {spots.FEWEST} stars are bright and not saturated"
    notes |= _residual_note(lens.residual_px, psf)
    return Calibration(
        size_px, lens, int(sum(keep.sum() for keep in lens.used)), [one.name for one in seen], unsolved,
        psf, _noise(seen, known, why), _hot(seen, lens, size_px), why, notes, _apart(lens.attitudes),
    )  # fmt: skip


def _apart(attitudes):
    """Largest angle between the boresights of attitudes C_ci, rad; 0 of a single one."""
    axes_i = np.array([C_ci[2] for C_ci in attitudes])
    chords = np.linalg.norm(axes_i[:, None] - axes_i, axis=2)  # exact for small angles
    return float(2.0 * np.arcsin(min(0.5 * chords.max(), 1.0)))


def check_together(seen):
    """CalibrationError where pictures have several sizes or depths, or are one. seen : list of Seen"""
    sizes = {one.size_px: one.name for one in reversed(seen)}
    if len(sizes) > 1:
        said = ", ".join(f"{name} has {w} x {h} pixels" for (w, h), name in sizes.items())
        raise CalibrationError(f"pictures of one camera have one size; {said}")
    depths = {one.depth: one.name for one in reversed(seen)}
    if 8 in depths and 16 in depths:
        raise CalibrationError(
            "pictures of one camera have one depth; "
            f"{depths[8]} has 8 bits a pixel, {depths[16]} grey values above 255"
        )
    firsts = {}
    for one in seen:
        first = firsts.setdefault(one.digest, one)
        if first is not one:  # its errors would count as new ones, and all sigmas come out too small
            raise CalibrationError(
                f"{one.name} has the grey values of {first.name}: it is the same picture; give it once"
            )


def check_one_lens(seen):
    """Notes on the focal length, {} of a good set; CalibrationError where pictures have several.

    seen : list of Seen
    """
    if len(seen) < 2:
        return {}
    found = lens_fit.focal_lengths([one.sights for one in seen], [one.lens for one in seen], seen[0].size_px)
    groups = lens_fit.groups(found)
    if len(groups) > 1:
        said = [
            f"{', '.join(seen[n].name for n in one.members)}: {one.focal_px:.1f} +- {one.sigma_px:.1f} px"
            for one in groups
        ]
        raise CalibrationError(
            f"the pictures have {len(groups)} focal lengths; {'; '.join(said)}; they are not of one camera, "
            "its zoom or focus was touched, or it turned under a rolling shutter: calibrate each by itself"
        )
    if len(lens_fit.groups(found, untouched=0.0)) == 1:
        return {}
    scatter = 100.0 * float(np.std(found.values) / found.values.mean())
    words = (
        f"that of single pictures scatters by {scatter:.1g} %, more than their stars say: sigma is too small"
    )
    return {"focal_length_px": words}


def _residual_note(residual_px, psf):
    """Note on stars that are further from the lens than noise puts them. psf : (value, sigma) px or None"""
    limit = WORST_PX if psf is None else max(WORST * psf[0], WORST_PX)
    if residual_px <= limit:
        return {}
    words = f"more than {limit:.2g} px, which noise of centroids does not reach: do not rely on this lens"
    return {"residual_px": words}


def _named(one):
    return f"{one.name} ({one.reason})"


def _noise(seen, known, why):
    """Noise of all pictures, None with a reason in `why`."""
    levels = [level for one in seen for level in one.levels]
    if not levels:
        little = "too little sky is free of stars and above grey value 0, where its noise is cut off"
        why["noise"] = next((one.no_levels for one in seen if one.no_levels), little)
        return None
    found = noise.told(levels, known.black_dn, known.electrons_per_dn)
    if found is None:
        why["noise"] = "it is less than rounding to whole grey values lets see"
        return None
    why.update(found.why)
    return found


def _hot(seen, lens, size_px):
    """HotPixels; stars are masked where the lens puts them."""
    marks = _marks(size_px)

    def shifts(n, other):
        C = lens.attitudes[n] @ lens.attitudes[other].T
        return lens_fit.places(lens.values, C, marks, size_px) - at_first

    at_first = lens_fit.places(lens.values, np.eye(3), marks, size_px)
    direction = hot_pixels.directions(shifts, len(seen))
    covered = []
    for one, C_ci in zip(seen, lens.attitudes, strict=True):
        at = lens_fit.lens_of(lens.values, C_ci)
        faint = pictures.faint_stars(at, size_px, one.year)
        radii = np.concatenate([one.radius_px, np.full(len(faint), hot_pixels.NEAR_PX)])
        covered.append(hot_pixels.near_stars(np.concatenate([one.detected_px, faint]), radii, size_px))
    return hot_pixels.find([one.bright for one in seen], covered, direction, size_px)


def _marks(size_px):
    """Directions that are spread over the picture of any camera: (5, 3), the middle one first."""
    tangent = 0.02
    across = tangent * np.array([[0, 0], [1, 1], [1, -1], [-1, 1], [-1, -1]], dtype=float)
    u_c = np.column_stack([across, np.ones(5)])
    return u_c / np.linalg.norm(u_c, axis=1, keepdims=True)
