"""The star catalogue that flies: which stars, and the table of their pairs.

In: all stars to V = 8 and the epoch of the mission. Out: `OnboardCatalogue` and `StarPairs`. The stars are
chosen in one of four ways (SHEFEX-2, section 3.3): everything to a magnitude; to one magnitude north and
another south of the equator; as evenly spread as possible; or the combination that flew, all bright stars
plus fainter ones where the sky would be empty. Stars that the camera cannot separate are one entry at their
centre of light.
"""

from typing import NamedTuple, get_args

import numpy as np

from shefex_nav.compiled import kernel
from shefex_nav.environment.stars import at_epoch, photocentres, select, silicon_magnitude
from shefex_nav.errors import UserError
from shefex_nav.geometry import triples as t3
from shefex_nav.onboard.startracker import tables
from shefex_nav.onboard.startracker.settings import Catalogue
from shefex_nav.settings import declared

SILICON_TO = 6.5  # magnitude in silicon: red stars to it that are fainter than V 8 are few
ENDS = f"the table of stars ends at V 8, which is whole to {SILICON_TO:g} in silicon"
KINDS, SYSTEMS = (get_args(declared(Catalogue)[name][0]) for name in ("kind", "system"))


class CatalogueError(UserError, ValueError):
    """No catalogue, or no pairs of its stars, can be made of the settings."""

    def __init__(self, words, field=()):
        """field : path of the setting in a scenario"""
        self.words, self.field = words, field
        super().__init__(f"{'.'.join(field)}: {words}" if field else words)

    @classmethod
    def of(cls, key, words):
        """About a key of settings.Catalogue."""
        return cls(words, ("star_tracker", "catalogue", key))


class OnboardCatalogue(NamedTuple):
    """Stars, brightest first."""

    hip: np.ndarray  # (n,) int64 Hipparcos number of the brightest star of each entry
    u_i: np.ndarray  # (n, 3) unit vectors at the epoch, without aberration
    vmag: np.ndarray  # (n,) magnitude of the summed light, V or in the system of the settings
    epoch: float = np.nan  # Julian year of u_i


class StarPairs(NamedTuple):
    """Pairs of stars that fit into the field of view, ordered by the cosine of their angle.

    cosine, first, second and their magnitudes are P, I, J, B_I and B_J of the brightness-referenced method.
    """

    stars: OnboardCatalogue
    cosine: np.ndarray  # (m,) ascending
    first: np.ndarray  # (m,) int64 row of the brighter star
    second: np.ndarray  # (m,) int64 row of the fainter star
    index: tables.KVector  # of cosine
    quick: tuple  # (tables.Stars, tables.Pairs), the same for the search
    first_vmag: np.ndarray  # (m,) magnitude of `first`
    second_vmag: np.ndarray  # (m,) magnitude of `second`


def build(settings, catalogue, julian_year, inclusive=True):
    """On-board catalogue of the given kind.

    Parameters
    ----------
    settings : Catalogue
    catalogue : StarCatalogue, deeper than the limits: faint neighbours shift the light of bright stars
    julian_year : float, epoch of the positions
    inclusive : bool, a star of exactly the limit belongs to the catalogue

    Returns
    -------
    OnboardCatalogue

    Raises
    ------
    CatalogueError : no such stars, or not as many
    ValueError : a kind or magnitude system that does not exist
    """
    if settings.kind not in KINDS:
        raise ValueError(f"unknown star catalogue {settings.kind!r}; choose from: {', '.join(KINDS)}")
    stars, magnitude = pool(settings, at_epoch(catalogue, julian_year), inclusive)
    rows = np.arange(len(magnitude))
    if settings.kind == "uniform":
        rows = spread_rows(stars.u_i, 0, settings.size)
    elif settings.kind == "combined":
        n_keep = int((magnitude <= settings.keep_to).sum())
        rows = spread_rows(stars.u_i, n_keep, settings.size)
    return OnboardCatalogue(
        stars.hip[rows].astype(np.int64),
        np.ascontiguousarray(stars.u_i[rows]),
        np.ascontiguousarray(magnitude[rows]),
        float(julian_year),
    )


def pool(settings, catalogue, inclusive=True):
    """Stars within the limits of magnitude, merged where they are too close: those that a catalogue may hold.

    An entry begins with a star that is itself within the limit of its hemisphere. In the Hp system the few
    stars without Hp (17 to V = 8, all close doubles) do not exist, not even as neighbours.

    Parameters
    ----------
    settings : Catalogue
    catalogue : StarCatalogue
    inclusive : as of `build`

    Returns
    -------
    stars : StarCatalogue, brightest first
    magnitude : (n,) of the summed light in the system of the settings
    """
    if settings.system not in SYSTEMS:
        choice = " or ".join(SYSTEMS)
        raise ValueError(f"unknown magnitude system {settings.system!r}; choose {choice}")
    catalogue = select(catalogue, ~np.isnan(magnitudes(catalogue, settings.system)))
    own = magnitudes(catalogue, settings.system)
    limit = limits(settings, catalogue.u_i)
    within = own <= limit if inclusive else own < limit
    if not within.any():
        raise CatalogueError.of(
            "faintest", f"no star is as bright as {settings.system} {settings.faintest:g}"
        )
    if settings.system == "silicon" and settings.faintest > SILICON_TO:
        raise CatalogueError.of("faintest", ENDS)
    if settings.system == "silicon":
        stars = photocentres(catalogue, own[within].max(), settings.merge_radius, own)
    else:
        stars = photocentres(catalogue, catalogue.vmag[within].max(), settings.merge_radius)
    stars = select(stars, np.isin(stars.hip, catalogue.hip[within]))
    stars = select(stars, np.argsort(magnitudes(stars, settings.system), kind="stable"))
    return stars, magnitudes(stars, settings.system)


def check_deepest(settings):
    """CatalogueError where stars are not whole to identification.deepest. settings : StarTracker"""
    deepest = settings.identification.deepest
    if settings.catalogue.system == "silicon" and deepest is not None and deepest > SILICON_TO:
        raise CatalogueError(ENDS, ("star_tracker", "identification", "deepest"))


def magnitudes(stars, system):
    """Magnitudes of stars in one of SYSTEMS: (n,), NaN where unknown."""
    if system == "silicon":
        return silicon_magnitude(stars.vmag, stars.bv)
    return stars.vmag if system == "V" else stars.hpmag


def limits(settings, u_i):
    """Limit of magnitude at each direction. Catalogue, (n, 3) -> (n,)."""
    south = settings.faintest_south
    if south is None:
        if settings.kind == "asymmetric":
            raise CatalogueError.of("faintest_south", "an asymmetric catalogue needs it")
        south = settings.faintest
    return np.where(u_i[:, 2] < 0.0, south, settings.faintest)


def spread_rows(u_i, n_keep, n_stars):
    """Rows of a thinned catalogue: the first n_keep stars, the rest as evenly spread as possible.

    Beyond those to keep, the stars are tried from bright to faint and taken when no taken star is nearer
    than a separation; the largest separation that still gives n_stars is found by bisection. The paper
    gives the outcome (2023 stars, 54 804 pairs), not the recipe.

    Parameters
    ----------
    u_i : (n, 3) unit vectors, brightest star first
    n_keep : int
    n_stars : int, size of the thinned catalogue

    Returns
    -------
    (n_stars,) int, ascending
    """
    n = len(u_i)
    if n_stars > n:
        words = f"{n_stars} stars are wanted, only {n} are within the limits of magnitude"
        raise CatalogueError.of("size", words)
    if n_stars < max(n_keep, 1):
        words = f"{n_stars} stars are wanted, but keep_to alone keeps {n_keep}"
        raise CatalogueError.of("size", words)
    u_i = np.ascontiguousarray(u_i)
    low, high = 0.0, np.pi
    rows = np.arange(n_stars)
    while high - low > 1e-5:  # rad; far finer than the step between two separations that matter
        separation = 0.5 * (low + high)
        taken, n_taken = _spread_kernel(u_i, n_keep, n_stars, np.cos(separation))
        if n_taken == n_stars:
            low, rows = separation, taken
        else:
            high = separation
    return rows


@kernel
def _spread_kernel(u_i, n_keep, n_stars, cos_separation):
    """Rows 0 ... n_keep - 1 and then each that is far enough from all taken, until there are n_stars."""
    taken = np.arange(n_stars)
    n = n_keep
    for k in range(n_keep, u_i.shape[0]):
        if n == n_stars:
            break
        free = True
        for j in range(n):
            if t3.dot(t3.row(u_i, k), t3.row(u_i, taken[j])) > cos_separation:
                free = False
                break
        if free:
            taken[n] = k
            n += 1
    return taken, n


def pair_table(stars, max_angle, radius=None):
    """All pairs of stars not further apart than max_angle [rad]. OnboardCatalogue -> StarPairs.

    radius : rad, from the axis to the farthest corner; None: the axis is in the middle of the field
    """
    cosine, first, second = _pairs_kernel(stars.u_i, np.cos(max_angle))
    order = np.argsort(cosine, kind="stable")
    cosine, first, second = cosine[order], first[order], second[order]
    if len(cosine) < 2:
        words = (
            f"no attitude is possible: of the {len(stars.hip)} stars of the catalogue, no two pairs fit into "
            f"the field of view, {np.degrees(max_angle):.3g} deg along its diagonal; take a shorter focal "
            "length, or a fainter star_tracker.catalogue.faintest"
        )
        raise CatalogueError(words, ("star_camera", "optics", "focal_length"))
    index = tables.k_vector(cosine)
    radius = 0.5 * max_angle if radius is None else radius
    quick = tables.build(stars, radius, cosine, first, second, index)
    return StarPairs(stars, cosine, first, second, index, quick, stars.vmag[first], stars.vmag[second])


@kernel
def _pairs_kernel(u_i, cos_max_angle):
    """Pairs (i < j) with a cosine of at least cos_max_angle, in the order of i and j."""
    n, size = 0, 1024
    cosines = np.empty(size)
    first, second = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.int64)
    for i in range(u_i.shape[0]):
        for j in range(i + 1, u_i.shape[0]):
            cosine = t3.dot(t3.row(u_i, i), t3.row(u_i, j))
            if cosine < cos_max_angle:
                continue
            if n == size:
                size *= 2
                cosines = np.concatenate((cosines, np.empty(n)))
                first = np.concatenate((first, np.empty(n, dtype=np.int64)))
                second = np.concatenate((second, np.empty(n, dtype=np.int64)))
            cosines[n], first[n], second[n] = cosine, i, j
            n += 1
    return cosines[:n].copy(), first[:n].copy(), second[:n].copy()
