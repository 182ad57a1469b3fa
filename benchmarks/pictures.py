"""Pictures of the night sky as strangers take them: how many `solve_image` solves, how well, and none wrong.

For each field of view (5 to 65 deg across) pictures of drawn attitudes, sizes, lenses and depths. The lenses
are rectilinear, with Brown's distortion and decentring, equidistant, stereographic and equisolid; none of the
last three is what is fitted. Vignetting, light of a city, clouds, trees, aircraft, motion, a tone curve and
JPEG of quality 60 to 95 are drawn besides. Projection, spots and spoils are this file's own.

A picture counts when eight stars of the catalogue are in it that stand out of the noise ten times and have no
tree before them. An answer is wrong when the middle of the picture is off by more than a hundredth of its
width, or up by more than 2 deg. NEES is of the attitude of the middle, 3 is expected. With --off the axis of
the lens is off the middle, by so many per cent of the width (1 sigma on each axis); without, in the middle.

    uv run python benchmarks/pictures.py [--seed 733] [--each 40] [--widths 5 10 20 40 65] [--mirrored]
        [--told] [--off 0.4] [--keep DIR]

Seeds below 100 are for tuning; docs/verification/pictures.md reports 733, 811 and 977.
"""

import argparse
import io
from pathlib import Path
from typing import NamedTuple

import numpy as np
from PIL import Image
from scipy.ndimage import gaussian_filter, zoom
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from shefex_nav.environment.ephemeris import sky_bodies
from shefex_nav.environment.stars import aberrate, at_epoch, load_catalogue

YEAR, MOMENT = 2024.5, "2024-07-02T03:00:00"  # the same
DAY = 2024.5001  # told of the pictures: 2024.5 would be no day, and the aberration would stay in
WIDTHS_DEG = (5.0, 10.0, 20.0, 40.0, 65.0)
FAINTEST = {5.0: (7.6, 8.2), 10.0: (6.3, 7.8), 20.0: (5.2, 6.8), 40.0: (4.2, 6.2), 65.0: (3.6, 5.8)}
SIZES = ((1024, 768), (1200, 800), (1280, 720), (800, 1200), (1600, 1200), (2400, 1600))
LENSES = ("rectilinear", "brown", "equidistant", "stereographic", "equisolid")
SNR = 10.0  # of a star that counts
ENOUGH = 8  # stars
SCATTER_MAG = 0.15  # the band of a camera is not V
BEYOND = 8.0  # V to which the catalogue knows stars; fainter ones are drawn anywhere
WRONG_SHARE, WRONG_ROLL_DEG = 0.01, 2.0


class Lens(NamedTuple):
    """Angle from the axis to distance from the middle, and what decentring adds."""

    kind: str
    focal_px: float
    k: tuple  # k1, k2, k3 of tan^2; p1, p2
    off_px: tuple = (0.0, 0.0)  # where the axis is, from the middle of the picture


class Shot(NamedTuple):
    """A picture and its truth."""

    image: np.ndarray  # uint8, as decoded
    C_ci: np.ndarray  # (3, 3) right, down, forward through the middle of the picture
    lens: Lens
    width_deg: float  # between the middles of the left and the right edge
    n_visible: int  # stars that count
    spoils: tuple  # names of what was drawn


def radius(lens, angle):
    """Distance from the middle [px] at an angle from the axis [rad]."""
    t = np.tan(np.minimum(angle, 1.4))
    if lens.kind == "equidistant":
        return lens.focal_px * angle
    if lens.kind == "stereographic":
        return lens.focal_px * 2.0 * np.tan(0.5 * angle)
    if lens.kind == "equisolid":
        return lens.focal_px * 2.0 * np.sin(0.5 * angle)
    k1, k2, k3 = lens.k[:3]
    return lens.focal_px * t * (1.0 + t**2 * (k1 + t**2 * (k2 + t**2 * k3)))


def places(lens, u_c, size_px):
    """Pixels of directions in camera axes: (n, 2)."""
    angle, around = np.arccos(np.clip(u_c[:, 2], -1.0, 1.0)), np.arctan2(u_c[:, 1], u_c[:, 0])
    r = radius(lens, angle)
    x, y = r * np.cos(around) / lens.focal_px, r * np.sin(around) / lens.focal_px
    p1, p2 = lens.k[3:]
    r2 = x * x + y * y
    x, y = x + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x), y + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return 0.5 * (np.array(size_px) - 1.0) + lens.off_px + lens.focal_px * np.column_stack([x, y])


def of_middle(lens, C_ci):
    """Attitude (3, 3) of the middle of the picture, by that of the axis of the lens."""
    far_px = np.hypot(*lens.off_px)
    if far_px == 0.0:
        return C_ci
    angle = brentq(lambda angle: float(radius(lens, angle)) - far_px, 0.0, 2.0 * far_px / lens.focal_px)
    x, y = np.array(lens.off_px) / far_px * angle  # the middle is seen at -x, -y: turned onto the axis
    return Rotation.from_rotvec([-y, x, 0.0]).as_matrix() @ C_ci


def draw_lens(rng, kind, size_px, width_deg):
    """A lens of this kind that shows width_deg from edge to edge."""
    half, edge = 0.5 * np.radians(width_deg), np.tan(0.5 * np.radians(width_deg))
    corner2 = edge**2 * (1.0 + (size_px[1] / size_px[0]) ** 2)
    k = np.zeros(5)
    if kind == "brown":  # barrel of a kit lens at its short end, pincushion at its long one
        at_corner = rng.uniform(-0.06, 0.03) * min(width_deg / 30.0, 1.0), rng.normal(0.0, 0.005)
        k[0], k[1] = at_corner[0] / corner2, at_corner[1] / corner2**2
        k[2] = rng.normal(0.0, 0.002) / corner2**3
        k[3:] = rng.normal(0.0, 0.0005, 2) / np.sqrt(corner2) * min(width_deg / 30.0, 1.0)
    unit = Lens(kind, 1.0, tuple(k))
    return unit._replace(focal_px=0.5 * size_px[0] / float(radius(unit, half)))


def spot(image, x, y, light, sigma_px, trail_px, angle):
    """Add a star: a Gaussian with a weak wing, along a trail."""
    n = max(1, int(np.ceil(2.0 * trail_px / sigma_px)))
    reach = int(np.ceil(6.0 * sigma_px + 0.5 * trail_px)) + 1
    if light > 3e4:
        reach *= 2
    r0, c0 = max(int(y) - reach, 0), max(int(x) - reach, 0)
    r1, c1 = min(int(y) + reach + 1, image.shape[0]), min(int(x) + reach + 1, image.shape[1])
    if r1 <= r0 or c1 <= c0:
        return
    rows, columns = np.arange(r0, r1)[:, None], np.arange(c0, c1)[None, :]
    for k in range(n):
        along = ((k + 0.5) / n - 0.5) * trail_px
        d2 = (columns - x - along * np.cos(angle)) ** 2 + (rows - y - along * np.sin(angle)) ** 2
        d2 = d2 / sigma_px**2
        core = 0.95 * np.exp(-0.5 * d2) / (2.0 * np.pi)
        wing = 0.05 * 1.5 / np.pi / 9.0 / (1.0 + d2 / 9.0) ** 2.5
        image[r0:r1, c0:c1] += light / n / sigma_px**2 * (core + wing)


def ground(rng, size_px):
    """Trees along one border: bool (rows, columns), True where they hide the sky."""
    w, h = size_px
    rough = gaussian_filter(rng.normal(size=(h, w)), 2.0)
    coarse = gaussian_filter(rng.normal(size=(h // 8 + 2, w // 8 + 2)), 3.0)
    coarse = zoom(coarse / coarse.std(), 8, order=1)[:h, :w]
    line = h * (1.0 - rng.uniform(0.1, 0.3) * (1.0 + 0.5 * np.sin(np.linspace(0.0, 7.0, w))))
    depth = (np.arange(h)[:, None] - line[None, :]) / (0.1 * h)
    return rough / rough.std() + 1.2 * coarse + 1.5 * depth > 1.2


def clouds_and_glow(rng, size_px, background):
    """Light from below, thin clouds: (rows, columns) grey values to add."""
    w, h = size_px
    y = np.arange(h)[:, None] / h
    light = rng.uniform(0.3, 1.5) * background * np.exp((y - 1.0) / 0.4) * np.ones((1, w))
    veil = gaussian_filter(rng.normal(size=(h // 16 + 2, w // 16 + 2)), 3.0)
    return light + 0.1 * background * zoom(veil / veil.std(), 16, order=1)[:h, :w]


def aircraft(rng, size_px, strength):
    """A dashed line from border to border."""
    w, h = size_px
    angle, y, x = rng.uniform(0.0, np.pi), *np.mgrid[0:h, 0:w]
    at = rng.uniform(0.2, 0.8, 2) * [w, h]
    off = -(x - at[0]) * np.sin(angle) + (y - at[1]) * np.cos(angle)
    along = (x - at[0]) * np.cos(angle) + (y - at[1]) * np.sin(angle)
    return strength * np.exp(-0.5 * (off / 1.3) ** 2) * (1.0 + np.sin(along / 9.0))


def shoot(rng, width_deg, kind, *, size_px=None, lens=None, off=(0.0, 0.0)):
    """A picture of a drawn attitude by a drawn lens of a kind, or by the lens and in the size that are given.

    size_px, lens : both or none;  off : of the width, x and y of the axis from the middle, of a drawn lens
    """
    drawn_px = SIZES[rng.integers(len(SIZES))]
    size_px = drawn_px if size_px is None else size_px
    width, height = size_px
    C_ci = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    C_ci *= np.linalg.det(C_ci)
    if lens is None:
        lens = draw_lens(rng, kind, size_px, width_deg)._replace(off_px=tuple(np.multiply(off, width)))
    faintest = rng.uniform(*FAINTEST[width_deg])
    sigma_px, noise, background = rng.uniform(0.8, 1.6), rng.uniform(1.0, 3.0), rng.uniform(10.0, 60.0)
    trail_px = rng.uniform(2.0, 6.0) if rng.random() < 0.25 else 0.0
    drawn = {name: rng.random() < chance for name, chance in (
        ("glow", 0.4), ("trees", 0.25), ("aircraft", 0.2), ("tone", 0.35), ("jpeg", 0.8))}  # fmt: skip
    stars = at_epoch(load_catalogue(BEYOND), YEAR)
    u_c = aberrate(stars.u_i, sky_bodies(MOMENT).earth_v_i) @ C_ci.T
    corner = np.radians(width_deg) * 0.5 * np.hypot(width, height) / width * 1.3
    ahead = u_c[:, 2] > np.cos(min(corner, 1.3))
    u_c, mag = u_c[ahead], stars.vmag[ahead]
    xy_px = places(lens, u_c, size_px)
    on = ((xy_px > 2.0) & (xy_px < np.array(size_px) - 3.0)).all(axis=1)
    n_faint = int(rng.poisson(2.0 * max(on.sum(), 5))) if faintest > BEYOND - 0.5 else 0
    shade = 1.0 - rng.uniform(0.0, 0.6) * (
        ((np.mgrid[0:height, 0:width].T - 0.5 * np.array([height, width])) ** 2).sum(axis=2).T
        / (0.25 * (width**2 + height**2))
    )
    # a star of the faintest magnitude stands out ten times at the middle
    unit = SNR * noise * np.sqrt(4.0 * np.pi) * sigma_px * np.sqrt(1.0 + trail_px / (3.5 * sigma_px))
    seen_mag = mag + rng.normal(0.0, SCATTER_MAG, len(mag))
    light = unit * 10.0 ** (-0.4 * (seen_mag - faintest))
    image, angle = np.zeros((height, width)), rng.uniform(0.0, np.pi)
    for (x, y), one in zip(xy_px, light, strict=True):
        spot(image, x, y, one, sigma_px, trail_px, angle)
    for _ in range(n_faint):
        x, y = rng.uniform(0.0, size_px)
        spot(
            image, x, y, unit * 10.0 ** (-0.4 * (rng.uniform(8.0, 9.0) - faintest)), sigma_px, trail_px, angle
        )
    image = shade * (image + background)
    if drawn["glow"]:
        image += shade * clouds_and_glow(rng, size_px, background)
    hidden = ground(rng, size_px) if drawn["trees"] else np.zeros((height, width), dtype=bool)
    if drawn["aircraft"]:
        image += aircraft(rng, size_px, 40.0 * noise)
    image = np.where(hidden, 0.3 * background, image)
    image = image + rng.normal(0.0, noise, image.shape)
    column, row = np.clip(np.rint(xy_px[on]).astype(int), 0, np.array(size_px) - 1).T
    stands_out = light[on] * shade[row, column] >= unit
    n_visible = int((stands_out & ~hidden[row, column]).sum())
    return Shot(
        developed(rng, image, drawn), of_middle(lens, C_ci), lens, width_deg, n_visible,
        tuple(name for name, is_drawn in drawn.items() if is_drawn) + (("motion",) if trail_px else ()),
    )  # fmt: skip


def developed(rng, image, drawn):
    """8 bits, by a tone curve and JPEG where they are drawn."""
    image = np.clip(image, 0.0, 255.0)
    if drawn["tone"]:
        image = 255.0 * (image / 255.0) ** (1.0 / 1.6)
    grey = np.rint(image).astype(np.uint8)
    if not drawn["jpeg"]:
        return grey
    file = io.BytesIO()
    Image.fromarray(grey).save(file, "JPEG", quality=int(rng.integers(60, 96)))
    return np.asarray(Image.open(file))


def shots(seed, width_deg, n, off_share=0.0):
    """n pictures of one width, the lenses in turn; off_share : of the width, 1 sigma, of their axes."""
    for k in range(n):
        key = [seed, int(width_deg), k]
        off = off_share * np.random.default_rng([*key, 1]).normal(size=2)
        yield shoot(np.random.default_rng(key), width_deg, LENSES[k % len(LENSES)], off=off)


class Judged(NamedTuple):
    """One answer against the truth."""

    is_solved: bool
    is_wrong: bool
    off_px: float  # of the middle
    nees: float
    ms: float


def judge(shot, found):
    """How good an ImageSolution is."""
    from shefex_nav.geometry.rotation import dcm_from_quat, quat_from_dcm, rotvec_from_quat

    nan = float("nan")
    if found.status != "ok":
        return Judged(False, False, nan, nan, found.wall_ms)
    # q_ic(true) = q_ic exp(d): C_ci(true) = exp(-d) C_ci
    C = dcm_from_quat(found.q_ci)
    d = rotvec_from_quat(quat_from_dcm(C @ shot.C_ci.T))
    across, about = np.hypot(d[0], d[1]), abs(d[2])
    is_wrong = across > WRONG_SHARE * np.radians(shot.width_deg) or about > np.radians(WRONG_ROLL_DEG)
    nees = d @ np.linalg.solve(found.covariance, d) if found.covariance is not None else nan
    return Judged(True, bool(is_wrong), float(across * shot.lens.focal_px), float(nees), found.wall_ms)


def options_of(shot, args):
    """What is told of a picture."""
    told = {"fov_deg": shot.width_deg} if args.told else {}
    return told | ({"mirrored": True} if args.mirrored else {})


def main():
    """Print a row for each width."""
    from shefex_nav.solve.image import solve_image

    parser = argparse.ArgumentParser()
    parser.add_argument("--seed", type=int, default=733)
    parser.add_argument("--each", type=int, default=40)
    parser.add_argument("--widths", type=float, nargs="+", default=WIDTHS_DEG)
    parser.add_argument("--told", action="store_true", help="the field of view is told")
    parser.add_argument("--mirrored", action="store_true", help="pictures are mirrored, and that is told")
    parser.add_argument("--off", type=float, default=0.0, help="per cent of the width, axis off the middle")
    parser.add_argument("--keep", type=Path, help="folder for the pictures that were not solved")
    args = parser.parse_args()
    print(
        "width  eight  solved  wrong  middle px: median, 90 %  NEES: mean, median  ms: median, 95 %  missed"
    )
    for width_deg in args.widths:
        judged, missed = [], []
        for k, shot in enumerate(shots(args.seed, width_deg, args.each, 0.01 * args.off)):
            image = np.ascontiguousarray(shot.image[:, ::-1]) if args.mirrored else shot.image
            found = solve_image(image, epoch=DAY, **options_of(shot, args))
            one = judge(shot, found)
            judged.append((shot, one))
            if one.is_wrong:
                print(f"WRONG: {width_deg:g} deg number {k}, {shot.lens.kind}, off {one.off_px:.1f} px")
            if not one.is_solved and shot.n_visible >= ENOUGH:
                missed.append(
                    f"{k}:{shot.lens.kind[:5]}/{shot.n_visible}/{'+'.join(shot.spoils)}:{found.reason}"
                )
                if args.keep:
                    Image.fromarray(image).save(args.keep / f"{width_deg:g}deg_{args.seed}_{k}.png")
        print(row(width_deg, judged), " ".join(missed), flush=True)


def row(width_deg, judged):
    """Figures of one width."""
    able = [one for shot, one in judged if shot.n_visible >= ENOUGH]
    solved = [one for _, one in judged if one.is_solved and not one.is_wrong]
    off, nees = np.array([one.off_px for one in solved]), np.array([one.nees for one in solved])
    ms = [one.ms for _, one in judged]
    share = sum(one.is_solved for one in able)
    quantiles = np.percentile(off, [50, 90]) if len(off) else (np.nan, np.nan)
    return (
        f"{width_deg:5g}  {len(able):5d}  {share:6d}  {sum(one.is_wrong for _, one in judged):5d}  "
        f"{quantiles[0]:15.2f} {quantiles[1]:8.2f}  {nees.mean():10.2f} {np.median(nees):7.2f}  "
        f"{np.median(ms):11.1f} {np.percentile(ms, 95):6.1f} "
    )


if __name__ == "__main__":
    main()
