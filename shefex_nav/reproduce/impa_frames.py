"""One field of stars at 0, 2 and 5 deg/s with both shutters, and what each method found in it.

Not a figure of the paper: the picture that its figures are about. The published chain sees two frames, as its
fusion needs; the known rate needs the second alone.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import pixels
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.streak import place_at, seen_from_to
from shefex_nav.reproduce import impa_field as field
from shefex_nav.reproduce import impa_flight as flight
from shefex_nav.reproduce import impa_methods as methods
from shefex_nav.reproduce import statistics
from shefex_nav.reproduce.experiment import Experiment, Row
from shefex_nav.reproduce.published import IMPA

RATES = (0.0, 2.0, 5.0)  # deg/s
FOUND_PX = 5.0  # an object this near to where a star is at the frame's instant is that star
MARGIN_PX = 2.0  # stars nearer to the border are not counted
SHOWN_SIGMA = (-1.0, 6.0)  # grey values, in units of the noise
METHODS = ("published", "rate-aided")


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
        clusters, fused = methods.multipole_chain.objects(methods.CHAIN, times, clusters, image)
    ours = methods.streaks_of(image, omega_c, P_omega_c, times)
    stars_px = catalogue_stars(case)
    lists = (fused, ours)
    near = [found_near(stars_px, one.xy_px) for one in lists]
    solved = (methods.published_attitude(fused) is not None, methods.own_attitude(ours) is not None)
    paths = [path_of(times, case.omega_c, xy_px) for xy_px in stars_px]
    return Sheet(image, paths, stars_px, tuple(one.xy_px for one in lists), np.array(near), solved)


def catalogue_stars(case):
    """Where the stars to V 5.5 are at the instant of the second frame, those on the detector: (n, 2) px."""
    C_ic = dcm_from_quat(field.attitude_at(case, 1))
    xy_px = pixels(field.CAMERA, np.ascontiguousarray(field.pairs(True).stars.u_i @ C_ic))
    size = np.array([field.CAMERA.width_px, field.CAMERA.height_px])
    inside = (xy_px > MARGIN_PX) & (xy_px < size - 1.0 - MARGIN_PX)
    return xy_px[inside.all(axis=1)]


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
            stars, solved = counts[:, s, r, :3].sum(axis=0), counts[:, s, r, 3:].sum(axis=0)
            for m, method in enumerate(METHODS):
                found, n = int(stars[1 + m]), int(stars[0])
                interval = statistics.proportion(found, n)
                out.append(
                    Row(f"stars to V 5.5 found, {method} [%]", condition, None, 100.0 * found / n,
                        tuple(100.0 * x for x in interval), None, "")
                )  # fmt: skip
                interval = statistics.proportion(int(solved[m]), len(counts))
                out.append(
                    Row(f"frames with an attitude, {method} [%]", condition, None, 100.0 * solved[m] / len(counts),
                        tuple(100.0 * x for x in interval), None, "")
                )  # fmt: skip
    return out


def draw(figure, results, rows):
    """Six frames: shutters down, rates across."""
    sheets = results[0][1]
    figure.set_size_inches(15.0, 10.6)
    axes = figure.subplots(len(field.SHUTTERS), len(RATES))
    noise = np.hypot(np.sqrt(field.BACKGROUND), IMPA["noise"]["read_std_e"]) / field.ELECTRONS_PER_DN
    level = field.BACKGROUND / field.ELECTRONS_PER_DN + field.BLACK_LEVEL_DN
    low, high = (level + k * noise for k in SHOWN_SIGMA)
    for k, (ax, one) in enumerate(zip(axes.ravel(), sheets, strict=True)):
        ax.imshow(one.image_dn, cmap="gray", vmin=low, vmax=high, interpolation="antialiased")
        for path_px in one.paths_px:
            middle, half = path_px[20], 0.5 * np.linalg.norm(path_px[-1] - path_px[0]) + 12.0
            ax.plot(*_ring(middle, half), color="#7f7f7f", lw=0.6)
        fused, ours = one.objects_px
        ax.plot(*ours.T, "+", color="#35d07f", ms=7, mew=1.2, label="rate-aided")
        ax.plot(*fused.T, "s", mfc="none", mec="#ffa132", ms=11, mew=1.3, label="published (two frames)")
        ax.set(xlim=(-0.5, 1023.5), ylim=(1023.5, -0.5), xticks=[], yticks=[])
        n = len(one.stars_px)
        counts = ", ".join(
            f"{method} {found.sum()}{'' if solved else ', no attitude'}"
            for method, found, solved in zip(METHODS, one.found, one.solved, strict=True)
        )
        shutter = field.SHUTTERS[k // len(RATES)].replace("_", " ")
        ax.set_title(f"{RATES[k % len(RATES)]:g} deg/s, {shutter}\nof {n} stars: {counts}", fontsize=10)
    axes[0, 0].legend(loc="lower left", fontsize=9, framealpha=0.8)
    figure.suptitle(
        "The same stars at three rates, 0.2 s a row. Ringed: stars to V 5.5. Marks: objects found, where the "
        "star is in the middle of the exposure.",
        fontsize=11,
    )
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.97))


def _ring(middle, radius):
    """Circle as (2, 61)."""
    angle = np.linspace(0.0, 2.0 * np.pi, 61)
    return middle[0] + radius * np.cos(angle), middle[1] + radius * np.sin(angle)


EXPERIMENTS = {
    "impa-frames": Experiment(
        title="Frames at 0, 2 and 5 deg/s, and what each method finds in them (IMPA section 6)",
        samples=100,
        unit="attitudes and directions",
        chunk=5,
        measure=measure,
        conclude=conclude,
        draw=draw,
    )
}
