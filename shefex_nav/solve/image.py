"""Attitude from a picture of the night sky, of any camera.

The route: `picture` reads the file, `field` finds point-like objects with the detection that flies,
`patterns` and `triangles` propose attitudes and focal lengths by the shape of triangles, `lens` adjusts them,
and `proof` decides with the identification that flies. Nothing is given out that chance would make more often
than once in 10^7 pictures.
"""

from dataclasses import replace
from functools import lru_cache
from math import isfinite
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

import numpy as np

from shefex_nav import warmup
from shefex_nav.environment.stars import select
from shefex_nav.geometry.rotation import quat_from_dcm
from shefex_nav.onboard.startracker.identify.screen import MAX_DETECTIONS
from shefex_nav.solve import field, lens, patterns, picture, pointing, proof, told, triangles
from shefex_nav.solve.camera import Camera, undistorted
from shefex_nav.solve.header import Taken, of_header, this_year
from shefex_nav.solve.solution import ImageSolution, Match, failed

FOV_DEG = (6.5, 32.0)  # horizontal, when nothing is said about it
FOV_TOLERANCE = 1.2  # factor either way, of a field of view that is given
CAMERA_TOLERANCE = 1.02  # of the focal length of a given camera
ROUNDS = (8, 15, 24)  # brightest detections that form triangles, more and more
CLEAR, WORTH = 45.0, 18.0  # ln odds of proposals: tried at once, tried at all
TRIED = 8  # proposals a round, apart from the clear ones
LEAST = 5  # detections without which nothing is begun
BLEND_PX = 2.5  # closer stars are one point of light
FAINT_NEIGHBOUR = 1.5  # mag, a star may be fainter than the faintest and still pull a brighter one
DEEPER, DEEPER_BY = 1.5, 15  # stars for so many detections: the sky is uneven, and some are hidden
BRIGHTNESS = 1.2  # mag, between a detection and its star: band, saturation, noise


class _Clock:
    """Time since it was made, without the waits for tables."""

    def __init__(self):
        self.began = perf_counter()

    def wait_for(self, make, *arguments):
        """The result of a function whose time does not count."""
        stopped = perf_counter()
        made = make(*arguments)
        self.began += perf_counter() - stopped
        return made

    def ms(self):
        """Milliseconds."""
        return 1e3 * (perf_counter() - self.began)


@lru_cache(maxsize=4)
def _load(year):
    """Stars and compiled code, before the clock runs: something small through all stages."""
    patterns.catalogue(year)
    patterns.magnitudes()
    grid = np.mgrid[40:200:40, 40:200:40].reshape(2, -1).T.astype(float)
    spots = np.random.default_rng(0).normal(0.0, 1.0, (256, 256)).astype(np.float32)
    for x, y in grid.astype(int):
        spots[y - 1 : y + 2, x - 1 : x + 2] += [[10.0, 20.0, 10.0], [20.0, 40.0, 20.0], [10.0, 20.0, 10.0]]
    field.find(spots)
    at = lens.Lens(np.eye(3), 2000.0, 0.0)
    flux = np.linspace(2.0, 1.0, len(grid))
    search = _Search((256, 256), (1900.0, 2100.0), year, True)
    sky = _sky(at, 60, search.size_px, year)
    perfect = lens.fit(at, sky.u_i, lens.project(at, sky.u_i, search.size_px)[0], search.size_px)
    proof.prove(perfect, sky, grid, flux, search.size_px, 1.0)
    lens.directions(Camera(256, 256, 2000.0, None, (0.1, 0.0, 0.0, 0.0, 0.0)), grid)
    band = patterns.band(patterns.bands(0.5, 0.5)[0], year)
    cells = triangles.detection_cells(grid, *search.size_px)
    spots = triangles.Spots(grid, flux, (256.0, 256.0), cells)
    triangles.propose(spots, (400.0, 600.0), 2, 4, band, np.zeros((triangles.KEPT, 11)), 0)


class _Search(NamedTuple):
    """What is looked for."""

    size_px: tuple  # (width, height)
    focal_range: tuple  # (shortest, longest) focal length [px]
    year: float
    may_distort: bool


def solve_image(image, *, camera=None, fov_deg=None, epoch=None, taken=None):
    """Attitude, field of view and stars of a picture of the night sky.

    The lens may have a radial distortion of a few per cent. Mirrored pictures are refused. The tables for a
    range of fields of view are made when they are first needed, 0.1 to 0.4 s each, and kept.

    With a StarCamera the picture goes through the star tracker that flies, and the solution has covariances.

    Parameters
    ----------
    image : path of a picture file, or an array (rows, columns[, channels]) of grey values, row 0 at the top
    camera : None, a Camera whose focal length is right to two per cent, or a StarCamera
    fov_deg : None, or the horizontal field of view, right to 20 per cent; by default anything from 7 to 30
    epoch : None or a Julian year, for proper motions, with a StarCamera for the velocity of the Earth as
        well; by default the date of the file, else today
    taken : None or a Taken, of an array and with a StarCamera only; a file says it itself

    Returns
    -------
    ImageSolution; a picture that cannot be solved is not an error

    Raises
    ------
    PictureError : a file that cannot be read, or an array that is no picture, or none of the StarCamera
    ValueError : any other argument
    """
    is_array = isinstance(image, np.ndarray)
    if taken is not None and not (is_array and isinstance(camera, told.StarCamera)):
        raise ValueError("taken: goes with an array and a StarCamera; the file of a picture says it itself")
    if isinstance(camera, told.StarCamera):
        if fov_deg is not None:
            raise ValueError("fov_deg: not together with a camera, which has its own")
        image_dn, taken = (image, taken or Taken()) if is_array else _as_stored(image, camera)
        if epoch is not None:
            taken = taken._replace(julian_year=_year(epoch, None))
        warmup.get_ready({"command=solve"})
        return told.solve(image_dn, camera, taken)
    seen = picture.Picture(picture.grey(image), None) if is_array else picture.read(image)
    return solve_picture(seen, camera=camera, fov_deg=fov_deg, epoch=epoch)


def _as_stored(path, camera):
    """Grey values of a file of a StarCamera, and Taken; PictureError names the file."""
    path, hole = Path(path), camera.params.camera.pinhole
    if path.suffix.lower() in picture.RAW:
        return picture.raw(path, (hole.width_px, hole.height_px), camera.bits), Taken()
    found = picture.stored(path)
    try:
        taken = of_header(found.header)
        if taken.julian_year is None:
            taken = taken._replace(julian_year=found.julian_year)
        return told.checked(found.values, camera), taken
    except ValueError as error:
        raise picture.PictureError(f"{path}: {str(error).removeprefix('image: ')}") from None


def solve_picture(seen, *, camera=None, fov_deg=None, epoch=None):
    """`solve_image` for a Picture that has been read."""
    warmup.get_ready({"command=solve"})
    size_px = seen.grey.shape[::-1]
    focal_range = _focal_range(size_px, camera, fov_deg)
    year = _year(epoch, seen.julian_year)
    _load(year)
    clock = _Clock()
    found = field.find(seen.grey)
    xy_px = found.xy_px
    if camera is not None:
        xy_px = _centred(camera, xy_px)
    search = _Search(size_px, focal_range, year, camera is None)
    solved, reason = _solve(xy_px[found.in_sky], found.flux[found.in_sky], search, clock)
    if solved is None and not found.in_sky.all():
        solved, reason = _solve(xy_px, found.flux, search, clock)
    if solved is None and reason == "no_match":
        turned = xy_px[found.in_sky] * [-1.0, 1.0] + [size_px[0] - 1.0, 0.0]
        if _solve(turned, found.flux[found.in_sky], search, clock)[0] is not None:
            reason = "mirrored"
    if solved is None:
        return failed(reason, clock.ms(), found.xy_px)
    return _described(solved, found, xy_px, size_px, year, camera, clock)


def _focal_range(size_px, camera, fov_deg):
    """Shortest and longest focal length [px] to look for."""
    width = size_px[0]
    if camera is not None:
        if fov_deg is not None:
            raise ValueError("fov_deg: not together with a camera, which has its own")
        if not isinstance(camera, Camera):
            raise ValueError(f"camera: expected a Camera, got {camera!r}")
        if (camera.width_px, camera.height_px) != size_px:
            raise ValueError(
                f"camera: has {camera.width_px} x {camera.height_px} pixels, "
                f"the picture {size_px[0]} x {size_px[1]}"
            )
        return camera.focal_length_px / CAMERA_TOLERANCE, camera.focal_length_px * CAMERA_TOLERANCE
    narrow, wide = FOV_DEG
    if fov_deg is not None:
        if not (np.isscalar(fov_deg) and isfinite(fov_deg) and narrow <= fov_deg <= wide):
            raise ValueError(f"fov_deg: expected {narrow} to {wide} degrees, got {fov_deg!r}")
        narrow, wide = max(fov_deg / FOV_TOLERANCE, narrow), min(fov_deg * FOV_TOLERANCE, wide)
    return tuple(0.5 * width / np.tan(0.5 * np.radians(fov)) for fov in (wide, narrow))


def _year(epoch, seen_year):
    """Epoch of the star positions."""
    if epoch is None:
        return seen_year if seen_year is not None else this_year()
    if not (np.isscalar(epoch) and isfinite(epoch) and 1900.0 < epoch < 2200.0):
        raise ValueError(f"epoch: expected a Julian year between 1900 and 2200, got {epoch!r}")
    return float(epoch)


def _centred(camera, xy_px):
    """Pixels of an ideal camera with its axis in the middle of the picture, from those of a given camera."""
    size_px = camera.width_px, camera.height_px
    return undistorted(camera, xy_px) - camera.principal_point_px + lens.middle(size_px)


def _solve(xy_px, flux, search, clock):
    """The (Fit, Proof) that is true, or None; and the reason."""
    if len(flux) < LEAST:
        return None, "too_few_stars"
    xy_px, flux = np.ascontiguousarray(xy_px[:MAX_DETECTIONS]), flux[:MAX_DETECTIONS]
    cells, wide_px = triangles.detection_cells(xy_px, *search.size_px), tuple(map(float, search.size_px))
    spots = triangles.Spots(xy_px, -2.5 * np.log10(flux), wide_px, cells)
    size = np.sqrt(search.size_px[0] * search.size_px[1])
    numbers = patterns.bands(size / search.focal_range[1], size / search.focal_range[0])
    kept, filled = np.zeros((len(numbers), triangles.KEPT, 11)), np.zeros(len(numbers), dtype=np.int64)
    done, reason = set(), "no_match"
    for first, last in zip((2, *ROUNDS[:-1]), ROUNDS, strict=True):
        for b in (*range(len(numbers)), -1):  # each band for itself, then the best of all
            if b >= 0 and first < len(flux):
                band = clock.wait_for(patterns.band, numbers[b], search.year)
                faintest = first, min(last, len(flux))
                filled[b], _ = triangles.propose(
                    spots, search.focal_range, *faintest, band, kept[b], filled[b]
                )
            chosen = kept[b] if b >= 0 else kept.reshape(-1, 11)
            for proposal in _best(chosen, CLEAR if b >= 0 else WORTH, done):
                fit, outcome = _examined(proposal, xy_px, flux, search)
                if outcome is not None and outcome.is_true:
                    return (fit, outcome), ""
                if outcome is not None and outcome.is_rivalled:
                    reason = "ambiguous"
    return None, reason


def _best(kept, least, done):
    """The best proposals with at least these odds that are not in `done`, where they are put."""
    chosen = []
    for proposal in kept[np.argsort(-kept[:, 0])]:
        if len(chosen) == TRIED or proposal[0] < least:
            break
        if tuple(proposal) not in done:
            done.add(tuple(proposal))
            chosen.append(proposal.copy())
    return chosen


def _examined(proposal, xy_px, flux, search):
    """Fit and Proof of a proposal; None, None when nothing fits."""
    size_px, focal_range, year, may_distort = search
    first = lens.Lens(proposal[2:].reshape(3, 3), float(proposal[1]), 0.0)
    sky = _sky(first, DEEPER * len(flux) + DEEPER_BY, size_px, year)
    if len(sky.hip) < LEAST:
        return None, None
    fit = lens.fit(first, sky.u_i, xy_px, size_px, least=proof.MIN_MATCHED, may_distort=may_distort)
    if fit is None or not 0.98 * focal_range[0] < fit.lens.focal_px < 1.02 * focal_range[1]:
        return None, None
    log_range = np.log(focal_range[1] / focal_range[0])
    return fit, proof.prove(fit, sky, xy_px, flux, size_px, log_range)


def _sky(at, n_stars, size_px, year):
    """Stars in and a little around a picture, to the magnitude that so many are in it in the mean."""
    stars = patterns.catalogue(year)
    vmag = patterns.magnitude_of(n_stars * at.focal_px**2 / (size_px[0] * size_px[1]))
    radius = np.arctan(0.5 * np.hypot(*size_px) / at.focal_px) + 0.01
    near = (stars.u_i @ at.C_ci[2] > np.cos(radius)) & (stars.vmag <= vmag + FAINT_NEIGHBOUR)
    return patterns.merged(select(stars, near), vmag, BLEND_PX / at.focal_px)


def _described(solved, found, xy_px, size_px, year, camera, clock):
    """ImageSolution of a proven fit."""
    fit, outcome = solved
    star, sky = _all_stars(fit, found.flux, xy_px, size_px, year)
    known = np.flatnonzero(star >= 0)
    matched = [
        Match(int(sky.hip[s]), float(x), float(y), float(sky.vmag[s]))
        for s, (x, y) in zip(star[known], found.xy_px[known], strict=True)
    ]
    ra, dec, roll, fov_x, fov_y = _pointing(fit.lens, size_px, camera)
    if camera is None:
        camera = proof.camera_of(fit.lens, size_px)
    else:
        camera = replace(camera, focal_length_px=fit.lens.focal_px)
    return ImageSolution(
        "ok", "", ra, dec, roll, fov_x, fov_y, matched, outcome.false_probability, clock.ms(),
        quat_from_dcm(fit.lens.C_ci), camera, found.xy_px,
    )  # fmt: skip


def _all_stars(fit, flux, xy_px, size_px, year):
    """Which star each detection is, faint ones included: row per detection, -1; and the stars.

    Among many faint detections and many faint stars, chance brings pairs together; those of the wrong
    brightness are left out. The zero point is that of the bright ones.
    """
    sky = _sky(fit.lens, max(2 * len(flux), MAX_DETECTIONS), size_px, year)
    predicted, _ = lens.project(fit.lens, sky.u_i, size_px)
    inside = np.flatnonzero(((predicted > -1.0) & (predicted < size_px)).all(axis=1))
    gate_px = max(lens.NOISE_GATE * fit.noise_px, lens.LEAST_GATE_PX)
    star = lens.match(predicted[inside], xy_px, gate_px)
    known = np.flatnonzero(star >= 0)
    star[known] = inside[star[known]]
    difference = -2.5 * np.log10(flux[known]) - sky.vmag[star[known]]
    zero = np.median(difference[: max(len(difference) // 2, 4)])
    star[known[np.abs(difference - zero) > BRIGHTNESS]] = -1
    return star, sky


def _pointing(at, size_px, camera):
    """RA and Dec of the middle of the picture, position angle of up, fields of view: degrees."""
    marks = pointing.marks(size_px)
    if camera is not None:
        marks = _centred(camera, marks)
    return pointing.angles(lens.directions(proof.camera_of(at, size_px), marks) @ at.C_ci)
