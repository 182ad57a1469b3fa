"""How a picture was solved, as pictures: one for each step, for those who want to know why it failed.

In: the grey values, the Record and the ImageSolution of a picture. Out: PNG files in a folder: background,
objects with the reasons for which some are none, fits of the centroids, hypotheses with their odds,
residuals. matplotlib is imported when they are drawn.

`draw_overlay` draws the picture with what was found in it, of a size that people look at: rings on the
detections, names beside the identified stars, placed where they cover no other star and no other name,
brightest star first; one without such a place is left out.
"""

import numpy as np

from shefex_nav.solve import background, field
from shefex_nav.solve.names import name_of

WIDTH_PX = 1000, 2000  # of the drawing; smaller pictures are enlarged, larger ones reduced, by whole factors
STARS, OTHERS, TEXT = (90, 230, 120), (230, 150, 60), (150, 225, 255)
RING_PX, GAP_PX = 9, 4  # radius of a ring, distance of the name from it
FONT_PX = 15
BANNER_PX = 28  # below the picture
BLACK_SIGMA, WHITE_SIGMA = -3.0, 14.0  # of the noise: grey values that become black and white
MOST_NAMES = 60
NAMES = ("1-background", "2-objects", "3-centroids", "4-hypotheses", "5-residuals")
OF_TRACKER = NAMES[1:3]
GREEN, ORANGE, RED, BLUE, GREY = "#009e73", "#e69f00", "#d55e00", "#56b4e9", "#767676"
PINK = "#ff8fd0"  # seen on the grey of a sky
SHOWN, HALF_PX = 24, 10  # centroids, and the pixels around each
NEAR_PX, WHITE = 4, 4  # white is the so-many-th brightest pixel so near: a hot one does not hide the star
LEAST_SHOWN = 1e-120  # probability
LEAST_ROWS, MOST_TRIALS = 12, 60


def draw(grey, record, solution, folder, steps=None):
    """Write the pictures of all steps that were reached, or of those of them that are wanted; their files.

    steps : some of NAMES; a star tracker that is told its camera has no others than OF_TRACKER to show
    """
    from matplotlib.figure import Figure

    written = []
    for name, step in zip(NAMES, (_background, _objects, _centroids, _hypotheses, _residuals), strict=True):
        if steps is not None and name not in steps:
            continue
        figure = Figure(figsize=(11.0, 8.0), dpi=110, layout="constrained")
        if step(figure, grey, record, solution):
            figure.savefig(folder / f"{name}.png")
            written.append(f"{name}.png")
    return written


def _background(figure, grey, record, solution):
    """What was taken for sky."""
    binning = record.field.binning
    small = field.binned(grey, binning) if binning > 1 else grey
    step = background.grey_step(grey)
    flat, noise, sky = background.flatten(np.ascontiguousarray(small, dtype=np.float32), step)
    left, right = figure.subplots(1, 2)
    extent = (-0.5, grey.shape[1] - 0.5, grey.shape[0] - 0.5, -0.5)
    shown = left.imshow(small - flat, cmap="viridis", extent=extent)
    figure.colorbar(shown, ax=left, shrink=0.5, label="grey values")
    left.set_title(f"background; noise of a pixel {noise:.3g} grey values")
    right.imshow(flat, cmap="gray", vmin=-3.0 * noise, vmax=14.0 * noise, extent=extent)
    edge = np.isfinite(sky)
    if edge.any():
        mask = np.where(np.kron(edge, np.ones((8, 8))), 1.0, np.nan)
        right.imshow(mask, cmap="autumn", alpha=0.25, extent=extent)
    right.set_title("without it; red: near an edge, where gaps are doubted")
    return True


def _sky(axes, grey):
    """The picture as people see it, under what is drawn."""
    canvas, _ = stretched(np.ascontiguousarray(grey, dtype=np.float32))
    axes.imshow(canvas, cmap="gray", extent=(-0.5, grey.shape[1] - 0.5, grey.shape[0] - 0.5, -0.5))


def _objects(figure, grey, record, solution):
    """Every object that the scan found, and why some are no stars."""
    found, axes = record.field, figure.subplots()
    _sky(axes, grey)
    for xy_px, colour, words in (
        (found.xy_px[found.in_sky & ~found.saturated], GREEN, "used"),
        (found.xy_px[found.in_sky & found.saturated], BLUE, "used, saturated in the middle"),
        (
            found.xy_px[~found.in_sky],
            ORANGE,
            "doubted: bead of a trail, gap in a foreground, block of a JPEG",
        ),
        (found.refused_px[found.refused_for == field.CROWDED], RED, "refused: no sky around it"),
        (
            found.refused_px[found.refused_for == field.FAINT],
            PINK,
            "refused: its middle is no more than noise",
        ),
    ):
        axes.plot(*xy_px.T, "o", mfc="none", mec=colour, ms=9, label=f"{len(xy_px)} {words}")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.03), ncols=2)
    return True


def _centroids(figure, grey, record, solution):
    """The brightest objects with the place of their fit and three standard deviations of its noise."""
    from matplotlib.patches import Ellipse

    found = record.field
    n = min(len(found.flux), SHOWN)
    if n == 0:
        return False
    columns = min(n, 6)
    panels = figure.subplots(-(-n // columns), columns, squeeze=False).ravel()
    half = HALF_PX * found.binning
    for k, axes in enumerate(panels):
        axes.set_axis_off()
        if k >= n:
            continue
        x, y = found.xy_px[k]
        r0, c0 = max(int(y) - half, 0), max(int(x) - half, 0)
        cut = grey[r0 : int(y) + half + 1, c0 : int(x) + half + 1]
        extent = (c0 - 0.5, c0 + cut.shape[1] - 0.5, r0 + cut.shape[0] - 0.5, r0 - 0.5)
        black, white = contrast(cut, (x - c0, y - r0), found.binning)
        axes.imshow(cut, cmap="gray", extent=extent, vmin=black, vmax=white)
        axes.plot(x, y, "+", color=RED, ms=10)
        values, vectors = np.linalg.eigh(found.P_px[k])
        angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
        size = 6.0 * np.sqrt(values)
        axes.add_patch(Ellipse((x, y), size[1], size[0], angle=angle, fill=False, color=RED))
        full = ", saturated" if found.saturated[k] else ""
        axes.set_title(f"{k}: sigma {np.sqrt(values.mean()):.2f} px{full}", fontsize=8)
    figure.suptitle(
        "brightest objects: fitted place, and three standard deviations by the noise of the pixels"
    )
    return True


def contrast(cut, xy_px, binning):
    """Grey values that are shown black and white, of the pixels around an object at a place in them."""
    near, (x, y) = NEAR_PX * binning, np.rint(xy_px).astype(int)
    around = np.sort(cut[max(y - near, 0) : y + near + 1, max(x - near, 0) : x + near + 1], axis=None)
    spread, white = _spread(cut), float(around[-min(WHITE * binning**2, around.size)])
    black = float(np.median(cut)) - 3.0 * spread
    return black, max(white, black + spread)


def _spread(values):
    """Standard deviation by the quartiles, not zero."""
    return max(float(np.subtract(*np.percentile(values, [75, 25]))) / 1.349, 1e-6)


def _hypotheses(figure, grey, record, solution):
    """What was tried: odds of the proposal, and what became of it."""
    trials = record.trials[:MOST_TRIALS]
    if not trials:
        return False
    axes = figure.subplots()
    width = grey.shape[1]
    for row, (proposal, fit, outcome) in enumerate(trials):
        fov = np.degrees(2.0 * np.arctan(0.5 * width / proposal[1]))
        axes.barh(row, proposal[0], color=GREY if fit is None else GREEN if outcome.is_true else ORANGE)
        if fit is None:
            words = "no lens fits it"
        else:
            chance = outcome.false_probability
            shown = f"{chance:.0e}" if chance >= LEAST_SHOWN else f"below {LEAST_SHOWN:.0e}"
            words = f"{(fit.star >= 0).sum()} stars at {fit.noise_px:.2f} px, probability of chance {shown}"
            words += ", proved" if outcome.is_true else ", not proved"
        axes.text(
            proposal[0], row, f"  {fov:.1f} deg, law xi {proposal[11]:.2g}: {words}", va="center", fontsize=8
        )
    axes.set_ylim(max(len(trials), LEAST_ROWS) - 0.5, -0.5)
    axes.set_yticks([])
    axes.set_xlim(0.0, 1.9 * max(one[0][0] for one in trials))
    axes.set_xlabel("ln odds of the proposal, by the stars near its triangle")
    axes.set_ylabel("in the order in which they were tried")
    axes.set_title(
        f"hypotheses: {len(record.trials)}; "
        + ("one is true" if solution.status == "ok" else f"none is true: {solution.reason.replace('_', ' ')}")
    )
    return True


def _residuals(figure, grey, record, solution):
    """Detections against where the adjusted lens puts their stars."""
    if record.adjusted is None:
        return False
    best, rest = record.adjusted, record.residual_px
    at = record.field.xy_px[record.known]
    axes = figure.subplots()
    _sky(axes, grey)
    scale = 0.05 * grey.shape[1] / max(float(np.percentile(np.hypot(*rest.T), 90)), 1e-6)
    for chosen, colour, words in ((best.used, GREEN, "weighed"), (~best.used, RED, "named, not weighed")):
        axes.quiver(
            *at[chosen].T, *(scale * rest[chosen]).T, color=colour, angles="xy", scale_units="xy", scale=1.0,
            width=0.002, label=f"{chosen.sum()} {words}",
        )  # fmt: skip
    for k in np.argsort([star.vmag for star in solution.matched])[:12]:
        axes.annotate(name_of(solution.matched[k].hip), at[k], color=BLUE, fontsize=8)
    _scale(axes, grey.shape, scale)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.03), ncols=2)
    axes.set_title(
        f"detection minus star, {scale:.0f} times as long; rms {best.residual_px:.2f} px; "
        f"covariances times {best.multiple:.2g}, floor {best.floor_px:.2f} px"
    )
    return True


def _scale(axes, shape, scale):
    """A bar in the lower left corner, as long as a residual of so many pixels is drawn."""
    longest_px = 0.1 * shape[1] / scale
    power = 10.0 ** np.floor(np.log10(longest_px))
    size_px = power * max(step for step in (1.0, 2.0, 5.0) if step * power <= longest_px)
    x, y = 0.03 * shape[1], 0.96 * shape[0]
    axes.plot([x, x + scale * size_px], [y, y], color=ORANGE, lw=3)
    axes.annotate(f"{size_px:g} px", (x, y), (0, 5), textcoords="offset points", color=ORANGE, fontsize=10)


def draw_overlay(grey, solution, path):
    """Write the drawing to a new PNG."""
    from PIL import Image, ImageDraw, ImageFont

    canvas, scale = stretched(grey)
    height, width = canvas.shape
    image = Image.new("RGB", (width, height + BANNER_PX))
    image.paste(Image.fromarray(canvas))
    pen, font = ImageDraw.Draw(image), ImageFont.load_default(size=FONT_PX)
    pen.text((8, height + 5), describe(solution), fill=TEXT, font=font)
    places = (solution.xy_px + 0.5) * scale - 0.5
    named = sorted(solution.matched, key=lambda star: star.vmag)
    at = [((star.x_px + 0.5) * scale - 0.5, (star.y_px + 0.5) * scale - 0.5) for star in named]
    known = {(round(x), round(y)) for x, y in at}
    for x, y in places:
        colour = STARS if (round(x), round(y)) in known else OTHERS
        pen.ellipse((x - RING_PX, y - RING_PX, x + RING_PX, y + RING_PX), outline=colour)
    taken = [(0.0, height - 1.0, float(width), height + BANNER_PX)]
    taken += [(x - RING_PX, y - RING_PX, x + RING_PX, y + RING_PX) for x, y in places]
    for star, (x, y) in list(zip(named, at, strict=True))[:MOST_NAMES]:
        name = name_of(star.hip)
        left, top, right, bottom = font.getbbox(name)
        place = free_place(x, y, right - left, bottom - top, image.size, taken)
        if place is not None:
            taken.append(place)
            pen.text((place[0] - left, place[1] - top), name, fill=TEXT, font=font)
    with open(path, "xb") as file:  # never over another file
        image.save(file, "PNG")


def stretched(grey):
    """8-bit picture without its background, of a size to look at, and the factor of that size."""
    width = grey.shape[1]
    scale = 1.0
    if width < WIDTH_PX[0]:
        scale = float(np.ceil(WIDTH_PX[0] / width))
        grey = np.kron(grey, np.ones((int(scale), int(scale)), dtype=np.float32))
    elif width > WIDTH_PX[1]:
        n = int(np.ceil(width / WIDTH_PX[1]))
        rows, columns = grey.shape[0] // n, grey.shape[1] // n
        # the brightest pixel of a block: the mean would make stars vanish
        grey = grey[: rows * n, : columns * n].reshape(rows, n, columns, n).max(axis=(1, 3))
        scale = 1.0 / n
    flat, noise, _ = background.flatten(np.ascontiguousarray(grey, dtype=np.float32))
    bright = (flat / noise - BLACK_SIGMA) / (WHITE_SIGMA - BLACK_SIGMA)
    return (255.0 * np.sqrt(np.clip(bright, 0.0, 1.0))).astype(np.uint8), scale


def describe(solution):
    """One line about the solution, and what the rings mean."""
    others = len(solution.xy_px) - len(solution.matched)
    if solution.status != "ok":
        return f"not solved: {solution.reason.replace('_', ' ')}   {others} objects (orange)"
    return (
        f"RA {solution.ra_deg:.3f} deg   Dec {solution.dec_deg:+.3f} deg   "
        f"roll {solution.roll_deg:.2f} deg   "
        f"field {solution.fov_x_deg:.2f} x {solution.fov_y_deg:.2f} deg   "
        f"{len(solution.matched)} stars (green)   {others} not named (orange)   background removed"
    )


def free_place(x, y, width, height, size, taken):
    """Box (left, top, right, bottom) for a name beside a star that covers nothing; None if there is none."""
    away = RING_PX + GAP_PX
    for left, top in (
        (x + away, y - 0.5 * height),
        (x - away - width, y - 0.5 * height),
        (x - 0.5 * width, y - away - height),
        (x - 0.5 * width, y + away),
        (x + 0.7 * away, y - 0.7 * away - height),
        (x + 0.7 * away, y + 0.7 * away),
        (x - 0.7 * away - width, y - 0.7 * away - height),
        (x - 0.7 * away - width, y + 0.7 * away),
    ):
        box = (left, top, left + width, top + height)
        inside = left >= 2 and top >= 2 and box[2] <= size[0] - 3 and box[3] <= size[1] - 3
        if inside and not any(
            box[0] < other[2] + 1
            and other[0] - 1 < box[2]
            and box[1] < other[3] + 1
            and other[1] - 1 < box[3]
            for other in taken
        ):
            return box
    return None
