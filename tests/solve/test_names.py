"""Names of stars."""

import numpy as np
import pytest
from astropy import units
from astropy.coordinates import SkyCoord, get_constellation

from shefex_nav.environment.stars import load_catalogue
from shefex_nav.solve import names

BAYER = {  # figures that every atlas has
    54061: "alpha UMa", 53910: "beta UMa", 58001: "gamma UMa", 59774: "delta UMa", 62956: "epsilon UMa",
    65378: "zeta UMa", 67301: "eta UMa", 27989: "alpha Ori", 24436: "beta Ori", 32349: "alpha CMa",
    11767: "alpha UMi", 91262: "alpha Lyr", 60718: "alpha1 Cru", 104214: "61 Cyg", 25930: "delta Ori",
}  # fmt: skip


@pytest.mark.parametrize("hip", BAYER)
def test_known_designations(hip):
    assert names.designation_of(hip) == BAYER[hip]


def test_one_name_for_each_star():
    """The proper one first, the number last."""
    lettered = next(hip for hip in names._designations() if hip not in names.PROPER_NAMES)
    assert names.name_of(54061) == "Dubhe" and names.name_of(lettered) == names.designation_of(lettered)
    nameless = next(hip for hip in load_catalogue(8.0).hip.tolist() if not names.designation_of(hip))
    assert names.name_of(nameless) == f"HIP {nameless}"


def test_no_two_stars_have_one_designation():
    told = list(names._designations().values())
    assert len(set(told)) == len(told)


def test_stars_are_in_their_constellations():
    """By the borders of 1930 (Roman 1987): all but those that Bayer and Flamsteed drew otherwise."""
    stars = load_catalogue(9.0)
    rows = [row for row, hip in enumerate(stars.hip.tolist()) if names.designation_of(hip)]
    x, y, z = stars.u_i[rows].T
    sky = SkyCoord(np.arctan2(y, x) * units.rad, np.arcsin(z) * units.rad)
    there = get_constellation(sky, short_name=True)
    told = [names.designation_of(hip) for hip in stars.hip[rows].tolist()]
    elsewhere = [one for one, name in zip(told, there, strict=True) if one[-3:].lower() != name.lower()]
    assert len(rows) == len(names._designations()) > 3400
    assert len(elsewhere) < 0.015 * len(rows) and "10 UMa" in elsewhere  # in Lynx, as every atlas notes
