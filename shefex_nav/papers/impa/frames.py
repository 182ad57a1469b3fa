"""One field of stars at 0, 2 and 5 deg/s with both shutters, and what each method found in it.

Not a figure of the paper: the picture that its figures are about. The published chain sees two frames, as its
fusion needs; the known rate needs the second alone.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.streak import place_at, seen_from_to
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import field, flight, trackers
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.picture import legend_below
from shefex_nav.papers.rows import together
from shefex_nav.papers.stills import on_detector
from shefex_nav.report import intervals

RATES = (0.0, 2.0, 5.0)  # deg/s
FOUND_PX = 5.0  # an object this near to where a star is at the frame's instant is that star
MARGIN_PX = 2.0  # stars nearer to the border are not counted
SHOWN_SIGMA = (-1.0, 3.5)  # grey values, in units of a pixel's noise
SHOWN_PX = (192.0, 832.0)  # part of the picture, rows and columns
SHOWN_DIRECTION = 24  # of the picture: (1, 1, 0), across the boresight along a diagonal
OUTLINE_PX = 9.0
METHODS = ("IMPA", "rate-aided")


class Sheet(NamedTuple):
    """One frame and its findings."""

    image_dn: np.ndarray  # (rows, columns)
    paths_px: list  # (41, 2) of each catalogue star in the frame
    stars_px: np.ndarray  # (n, 2) their places at the instant
    objects_px: tuple  # (m, 2) of METHODS
    found: np.ndarray  # (2, n) bool
    solved: tuple  # bool of METHODS


def sheet(shutter, case, seed):
    """Second frame of a simulation, and what was found: Sheet."""
    noise, gyro = (np.random.default_rng(s) for s in seed.spawn(2))
    omega_c, P_omega_c = field.gyro(case, gyro)
    times, clusters = field.times(shutter), None
    for number in range(2):
        image = flight.frame(shutter, case, number, noise)
        clusters, fused = trackers.chain.objects(trackers.DETECT, trackers.MODEL, times, clusters, image)
    motion = trackers.streaks.Motion(omega_c, P_omega_c, times)
    ours = trackers.streaks_of(image, omega_c, P_omega_c, times)
    stars_px = catalogue_stars(case)
    lists = (fused, ours)
    near = [found_near(stars_px, one.xy_px) for one in lists]
    solved = (
        trackers.published_attitudes(fused)[0] is not None,
        trackers.own_attitude(ours, motion) is not None,
    )
    paths = [path_of(times, case.omega_c, xy_px) for xy_px in stars_px]
    return Sheet(image, paths, stars_px, tuple(one.xy_px for one in lists), np.array(near), solved)


def catalogue_stars(case):
    """Where the stars to V 5.5 are at the instant of the second frame, those on the detector: (n, 2) px."""
    C_ic = dcm_from_quat(field.attitude_at(case, 1))
    xy_px = pixels(field.CAMERA, np.ascontiguousarray(field.pairs(True).stars.u_i @ C_ic))
    return xy_px[on_detector(field.CAMERA, xy_px, MARGIN_PX)]


def found_near(stars_px, objects_px):
    """Which stars have an object near: (n,) bool."""
    if not len(objects_px):
        return np.zeros(len(stars_px), dtype=bool)
    return np.linalg.norm(stars_px[:, None] - objects_px[None], axis=2).min(axis=1) < FOUND_PX


def path_of(times, omega_c, xy_px):
    """The way of a star during its exposure: (41, 2) px."""
    begin_s, end_s = seen_from_to(field.CAMERA, times, omega_c, *xy_px)
    return np.array([place_at(field.CAMERA, omega_c, *xy_px, t) for t in np.linspace(begin_s, end_s, 41)])


def measure(samples, seed):
    """Catalogue stars in the frame and found, and attitudes: (samples, 2, 3, 5), and the first sheets."""
    rows, first = np.empty((samples, len(field.SHUTTERS), len(RATES), 5)), None
    for k, own_seed in enumerate(seed.spawn(samples)):
        rng = np.random.default_rng(own_seed.spawn(1)[0])
        attitude, direction = rng.integers(field.N_ATTITUDES), rng.integers(field.N_DIRECTIONS)
        if first is None:
            direction = SHOWN_DIRECTION
        sheets = []
        for s, shutter in enumerate(field.SHUTTERS):
            for r, rate in enumerate(RATES):
                case = field.Case(np.radians(rate), int(attitude), int(direction))
                one = sheet(shutter, case, own_seed.spawn(1)[0])
                rows[k, s, r] = len(one.stars_px), *one.found.sum(axis=1), *one.solved
                sheets.append(one)
        first = first or sheets
    return rows, first


def conclude(results):
    """Share of the catalogue stars found, and of the frames solved."""
    counts = np.concatenate([rows for rows, _ in results])
    out = []
    for s, shutter in enumerate(field.SHUTTERS):
        for r, rate in enumerate(RATES):
            condition = f"{rate:g} deg/s, {shutter.replace('_', ' ')}"
            n_stars, *found = counts[:, s, r, :3].T
            solved, n = counts[:, s, r, 3:].sum(axis=0), len(counts)
            for m, method in enumerate(METHODS):
                part, ends = found[m].sum() / n_stars.sum(), together(found[m], n_stars)
                out.append(_share(f"stars to V 5.5 found, {method} [%]", condition, part, ends))
                part, ends = solved[m] / n, intervals.proportion(int(solved[m]), n)
                out.append(_share(f"frames with an attitude, {method} [%]", condition, part, ends))
    return out


def _share(quantity, condition, part, ends):
    """Row of a share and its interval, which the paper does not give, in per cent."""
    return Row(quantity, condition, None, 100.0 * part, ends and tuple(100.0 * end for end in ends))


def draw(figure, results, rows):
    """Six frames: shutters down, rates across; the middle of each."""
    sheets = results[0][1]
    figure.set_layout_engine("constrained")
    figure.set_size_inches(13.5, 9.8)
    axes = figure.subplots(len(field.SHUTTERS), len(RATES))
    noise = np.hypot(np.sqrt(field.BACKGROUND), IMPA["noise"]["read_std_e"]) / field.ELECTRONS_PER_DN
    level = field.BACKGROUND / field.ELECTRONS_PER_DN + field.BLACK_LEVEL_DN
    low, high = (level + k * noise for k in SHOWN_SIGMA)
    rows_px, columns_px = sheets[0].image_dn.shape
    for k, (ax, one) in enumerate(zip(axes.ravel(), sheets, strict=True)):
        pooled = one.image_dn.reshape(rows_px // 2, 2, columns_px // 2, 2).mean(axis=(1, 3))
        extent = (-0.5, columns_px - 0.5, rows_px - 0.5, -0.5)
        ax.imshow(pooled, cmap="gray", vmin=low, vmax=high, extent=extent, interpolation="nearest")
        for path_px in one.paths_px:
            ax.plot(*_outline(path_px).T, color="#6cb4ff", lw=0.9)
        fused, ours = one.objects_px
        ax.plot(*ours.T, "+", color="#35d07f", ms=8, mew=1.2, label="object, rate-aided (one frame)")
        ax.plot(*fused.T, "s", mfc="none", mec="#ffa132", ms=13, mew=1.4, label="object, IMPA (two frames)")
        ax.plot([], [], color="#6cb4ff", lw=0.9, label="star to V 5.5")
        ax.set(xlim=SHOWN_PX, ylim=SHOWN_PX[::-1], xticks=[], yticks=[])
        counts = ", ".join(
            f"{method} {found.sum()}{'' if solved else ' (no attitude)'}"
            for method, found, solved in zip(METHODS, one.found, one.solved, strict=True)
        )
        shutter = field.SHUTTERS[k // len(RATES)].replace("_", " ")
        rate = RATES[k % len(RATES)]
        ax.set_title(f"{rate:g} deg/s, {shutter}\nof {len(one.stars_px)} stars: {counts}", fontsize=10)
    legend_below(figure, axes[0, 0], 3, frameon=True, fontsize=10)
    figure.suptitle(
        "One field at three rates, 0.2 s a row (the middle of the frame, counts of the whole). "
        "Marks: where the object is in the middle of the exposure; without outline: fainter stars, mostly.",
        fontsize=11,
    )


def _outline(path_px):
    """A line around a streak, OUTLINE_PX away: (n, 2)."""
    along = path_px[-1] - path_px[0]
    heading = np.arctan2(along[1], along[0]) if np.hypot(*along) > 0.5 else 0.0
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 16) + heading
    cap = OUTLINE_PX * np.column_stack([np.cos(angle), np.sin(angle)])
    ring = np.concatenate([path_px[-1] + cap, path_px[0] - cap])
    return np.vstack([ring, ring[:1]])


EXPERIMENTS = {
    "impa-frames": Experiment(
        samples=100,
        unit="attitudes and directions",
        chunk=5,
        measure=measure,
        conclude=conclude,
        draw=draw,
    )
}
