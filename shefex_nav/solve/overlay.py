"""A picture with what was found in it: rings on the detections, names beside the identified stars.

In: grey values and an ImageSolution. Out: a PNG of the same size, or scaled to a size that people look at.
Names are placed where they cover no other star and no other name, brightest star first; one without such a
place is left out.
"""

import numpy as np

from shefex_nav.solve.background import flatten
from shefex_nav.solve.names import name_of

WIDTH_PX = (
    1000,
    2000,
)  # of the drawing; smaller pictures are enlarged, larger ones reduced, by whole factors
STARS, OTHERS, TEXT = (90, 230, 120), (230, 150, 60), (150, 225, 255)
RING_PX, GAP_PX = 9, 4  # radius of a ring, distance of the name from it
FONT_PX = 15
BANNER_PX = 28  # below the picture
BLACK_SIGMA, WHITE_SIGMA = -3.0, 14.0  # of the noise: grey values that become black and white
MOST_NAMES = 60


def draw(grey, solution, path):
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
    flat, noise, _ = flatten(np.ascontiguousarray(grey, dtype=np.float32))
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
