"""A picture with what was found in it: rings on the detections, names beside the identified stars.

In: grey values and an ImageSolution. Out: a PNG of the same size, or scaled to a size that people look at.
Names are placed where they cover no other star and no other name, brightest star first; one without such a
place is left out.
"""

import numpy as np

from shefex_nav.solve.field import flatten

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
        name = PROPER_NAMES.get(star.hip, f"HIP {star.hip}")
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
    """One line about the solution."""
    if solution.status != "ok":
        return f"not solved: {solution.reason.replace('_', ' ')}"
    return (
        f"RA {solution.ra_deg:.3f} deg   Dec {solution.dec_deg:+.3f} deg   "
        f"roll {solution.roll_deg:.2f} deg   "
        f"field {solution.fov_x_deg:.2f} x {solution.fov_y_deg:.2f} deg   {len(solution.matched)} stars"
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


# Names approved by the Working Group on Star Names of the IAU, by Hipparcos number.
PROPER_NAMES = {
    677: "Alpheratz", 746: "Caph", 1067: "Algenib", 2081: "Ankaa", 3179: "Schedar", 3419: "Diphda",
    5447: "Mirach", 6686: "Ruchbah", 7588: "Achernar", 8886: "Segin", 8903: "Sheratan",
    9640: "Almach", 9884: "Hamal", 10826: "Mira", 11767: "Polaris", 14135: "Menkar", 14576: "Algol",
    15863: "Mirfak", 17702: "Alcyone", 21421: "Aldebaran", 23015: "Hassaleh", 24436: "Rigel",
    24608: "Capella", 25336: "Bellatrix", 25428: "Elnath", 25930: "Mintaka", 25985: "Arneb",
    26311: "Alnilam", 26727: "Alnitak", 27366: "Saiph", 27989: "Betelgeuse", 28360: "Menkalinan",
    30324: "Mirzam", 30438: "Canopus", 31681: "Alhena", 32349: "Sirius", 33579: "Adhara",
    34444: "Wezen", 35904: "Aludra", 36188: "Gomeisa", 36850: "Castor", 37279: "Procyon",
    37826: "Pollux", 45238: "Miaplacidus", 46390: "Alphard", 49669: "Regulus", 50583: "Algieba",
    53910: "Merak", 54061: "Dubhe", 54872: "Zosma", 57632: "Denebola", 58001: "Phecda",
    59774: "Megrez", 59803: "Gienah", 60718: "Acrux", 60965: "Algorab", 61084: "Gacrux",
    62434: "Mimosa", 62956: "Alioth", 63125: "Cor Caroli", 63608: "Vindemiatrix", 65378: "Mizar",
    65474: "Spica", 67301: "Alkaid", 67927: "Muphrid", 68702: "Hadar", 68756: "Thuban",
    69673: "Arcturus", 71681: "Toliman", 71683: "Rigil Kentaurus", 72105: "Izar", 72607: "Kochab",
    72622: "Zubenelgenubi", 74785: "Zubeneschamali", 76267: "Alphecca", 77070: "Unukalhai",
    78401: "Dschubba", 78820: "Acrab", 80763: "Antares", 80816: "Kornephoros", 84012: "Sabik",
    84345: "Rasalgethi", 85670: "Rastaban", 85927: "Shaula", 86032: "Rasalhague", 86228: "Sargas",
    87833: "Eltanin", 90185: "Kaus Australis", 91262: "Vega", 92420: "Sheliak", 92855: "Nunki",
    93194: "Sulafat", 95947: "Albireo", 97278: "Tarazed", 97649: "Altair", 98036: "Alshain",
    100453: "Sadr", 100751: "Peacock", 101958: "Sualocin", 102098: "Deneb", 102488: "Aljanah",
    105199: "Alderamin", 106278: "Sadalsuud", 107315: "Enif", 107556: "Deneb Algedi",
    109074: "Sadalmelik", 109268: "Alnair", 112158: "Matar", 113368: "Fomalhaut", 113881: "Scheat",
    113963: "Markab",
}  # fmt: skip
