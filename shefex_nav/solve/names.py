"""Names of stars: those of the International Astronomical Union, Bayer's and Flamsteed's, else the number.

In: `data/designations.csv`, Hipparcos number and designation: Bayer's letter where there is one, else
Flamsteed's number, with the constellation in three letters, e.g. alpha UMa, 10 UMa.
"""

from functools import lru_cache
from importlib.resources import files


def name_of(hip):
    """Proper name of a star, else its designation, else HIP and its number."""
    return PROPER_NAMES.get(hip) or designation_of(hip) or f"HIP {hip}"


def designation_of(hip):
    """Designation of Bayer or Flamsteed, e.g. 'alpha UMa'; empty where there is none."""
    return _designations().get(hip, "")


@lru_cache(maxsize=1)
def _designations():
    """Designations by Hipparcos number."""
    text = (files("shefex_nav") / "data" / "designations.csv").read_text(encoding="utf-8")
    rows = (line.split(",") for line in text.splitlines()[1:])
    return {int(hip): designation for hip, designation in rows}


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
