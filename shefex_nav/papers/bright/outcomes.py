"""The methods that BRIGHT compares, and ours; how they are judged, and the rows of tables 3 and 4."""

from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.papers import rows
from shefex_nav.papers.bright import fields
from shefex_nav.papers.bright.fields import ARCSEC, MODEL, VOTING_TOLERANCE
from shefex_nav.papers.bright.methods import brightness, two_angles, voting
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.picture import COLOURS, tidy
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.verdict import POINTS
from shefex_nav.records import Reason
from shefex_nav.report import intervals

SUCCESS, FAILED, WRONG = 0, 1, 2
REPEATS = 3
TIME = (
    "compiled and joined by star, in a time proportional to the candidates, not to their square; the order "
    "of speeds is that of the comparisons"
)
OUTCOMES = ("success", "failed", "wrong")


def voting_3_epsilon(settings, camera, pairs, u_c, flux):
    """Voting with the wider tolerance that the paper gives it."""
    return voting.match(replace(settings, tolerance=VOTING_TOLERANCE), camera, pairs, u_c, flux)


# BRIGHT's pyramid must also believe a triangle: with three true stars it is never at a loss.
PUBLISHED = {
    "brightness_referenced": brightness.match,
    "pyramid": partial(pyramid.match, accept_triangle=True),
    "geometric_voting": voting_3_epsilon,
}


def default_of_ten(settings, camera, pairs, u_c, flux):
    """Our default with no more than the paper's methods have: the ten brightest detections."""
    n = settings.most_centroids
    return bayes.identify(settings, camera, pairs, u_c[:n], flux[:n])


OWN = {
    "default": bayes.identify,
    "default_of_ten": default_of_ten,
    "pyramid_verified": pyramid.identify,
}
METHODS = PUBLISHED | OWN

# One thing otherwise than in PUBLISHED: name -> (whose, what, function). They are not timed.
TWO_ANGLES, PAIRS_OF_TWO, COMPARED = "two angles", "clusters of two", "compared with before"
TRIANGLE_TOLERANCE, WIDE_VOTE = 15.0 * ARCSEC, 24.0 * ARCSEC  # [E] chosen so that table 3 comes out


def two_angles_match(settings, camera, pairs, u_c, flux):
    """The pyramid with triangles of two angles."""
    return two_angles.match(settings, camera, pairs, u_c, flux, TRIANGLE_TOLERANCE)


def clusters_of_two(settings, camera, pairs, u_c, flux):
    """Voting in which two identities that agree are believed, with 3 epsilon of 24 arcsec."""
    wide = replace(settings, tolerance=WIDE_VOTE)
    return voting.match(wide, camera, pairs, u_c, flux, least_cluster=2)


VARIANTS = {
    TWO_ANGLES: ("pyramid", "with triangles that close on two angles, 15 arcsec", two_angles_match),
    PAIRS_OF_TWO: ("geometric_voting", "with clusters of two and 3 epsilon = 24 arcsec", clusters_of_two),
    COMPARED: (
        "brightness_referenced", "with three stars compared with those of the frame before", brightness.match,
    ),
}  # fmt: skip
TRIED = METHODS | {name: function for name, (_, _, function) in VARIANTS.items()}


def judge(found, star):
    """The paper's terms: success if the stars are the right ones, wrong if one is not, failed if none."""
    known = found.star >= 0
    if found.reason != Reason.NONE or not known.any():
        return FAILED
    return SUCCESS if (found.star[known] == star[: len(known)][known]).all() else WRONG


def attempt(settings, reference_flux, tables, field):
    """Try each of METHODS on one field.

    The time is the shortest of REPEATS calls: what else the machine does comes and goes, and no method pays
    for what the one before left in the processor's cache.

    Parameters
    ----------
    settings : Identification
    reference_flux : float, as of `brightness.match`
    tables : StarPairs of the paper's methods, and of ours
    field : Field

    Returns
    -------
    outcome : (methods,) SUCCESS, FAILED or WRONG
    seconds : (methods,)
    """
    outcome, seconds = np.zeros(len(TRIED), dtype=np.int8), np.full(len(TRIED), np.inf)
    for m, (name, method) in enumerate(TRIED.items()):
        pairs = tables[1 if name in OWN else 0]
        more = {"reference_flux": reference_flux} if method is brightness.match else {}
        if name == COMPARED:  # as if the frame before had shown the same stars
            more["previous"] = field.star[field.star >= 0]
        for _ in range(1 if name in VARIANTS else REPEATS):
            began = perf_counter()
            found = method(settings, MODEL, pairs, field.u_c, field.flux, **more)
            seconds[m] = min(seconds[m], perf_counter() - began)
        outcome[m] = judge(found, field.star)
    return outcome, seconds


def outcome_rows(condition, method, codes, published, n_published):
    """Success, failed and wrong of one of the paper's methods, or of a variant of it."""
    shares = (published["success"], published["failed"] / n_published, published["wrong"] / n_published)
    found = []
    for code, (outcome, share) in enumerate(zip(OUTCOMES, shares, strict=True)):
        given = f"{method}: {outcome}", condition, share, (codes == code).sum(), len(codes)
        better = "more" if outcome == "success" else "less"
        found.append(rows.published_share(*given, n_published=n_published, better=better))
    return found


def method_rows(experiment, condition, codes, published, n_published):
    """Rows of all the paper's methods and their variants; codes: (methods, samples).

    A difference is explained by a variant that reaches the published figure in the same condition.
    """
    of, found = dict(zip(TRIED, codes, strict=True)), []
    for method in PUBLISHED:
        mine = outcome_rows(condition, method, of[method], published[method], n_published)
        for name, (whose, words, _) in VARIANTS.items():
            if whose == method:
                given = of[name], published[method], n_published
                others, run = outcome_rows(condition, f"{method}, {name}", *given), f"{experiment}/{name}"
                mine = [rows.explained(a, b, run, words) for a, b in zip(mine, others, strict=True)]
                mine += [tuned(b) for b in others]
        found += mine
    return found


def tuned(row):
    """A row of a variant whose tolerance was chosen with the table in sight."""
    return rows.variant(row if COMPARED in row.quantity else rows.calibrated(row))


def own_rows(condition, method, codes, n_stars):
    """Of one of our methods: success where there are four catalogue stars, and wrong of all."""
    possible = codes[n_stars >= 4]
    k_success = int((possible == SUCCESS).sum())
    four = f"{condition}, four catalogue stars"
    return [
        rows.share(f"{method}: success", four, k_success, len(possible)),
        rows.goal_none(f"{method}: wrong [fields]; goal: none", condition, codes == WRONG),
    ]


def time_rows(condition, chunk_seconds, published):
    """Mean times in units of the brightness-referenced method's.

    chunk_seconds : (chunks, methods) mean over the fields of each chunk
    """
    rng, names = np.random.default_rng(0), list(METHODS)
    base = names.index("brightness_referenced")
    mean_ms = float(1e3 * chunk_seconds[:, base].mean())
    found = [Row("brightness_referenced: mean time [ms]", condition, None, mean_ms)]
    for m, method in enumerate(names):
        if m == base:
            continue
        columns = chunk_seconds[:, m], chunk_seconds[:, base]
        measured = float(_ratio(*columns))
        interval = intervals.bootstrap(_ratio, columns, rng) if len(chunk_seconds) > 1 else None
        quantity = f"{method}: mean time over brightness_referenced's"
        if method not in published:
            found.append(Row(quantity, condition, None, measured, interval))
            continue
        wanted = published[method]["ms"] / published["brightness_referenced"]["ms"]
        how = {"resolves": 0.1 * wanted, "why": TIME}
        found.append(rows.figure(quantity, condition, wanted, measured, interval, len(chunk_seconds), **how))
    return found


def comparison_rows(condition, counted):
    """The order of the methods by comparisons, which is no matter of the machine. (methods, samples)"""
    of = dict(zip(PUBLISHED, counted, strict=True))
    slower = (("pyramid", "brightness_referenced"), ("geometric_voting", "pyramid"))
    found, most = [], {"least": np.nextafter(0.5, 1.0), "resolves": POINTS}
    for more, fewer in slower:
        k, n = int((of[more] > of[fewer]).sum()), len(of[more])
        quantity = f"fields in which {more} compares more than {fewer}; published: slower"
        given = k / n, intervals.proportion(k, n), n
        found.append(rows.statement(quantity, condition, None, *given, **most))
    base = np.maximum(of["brightness_referenced"], 1)
    names = [method for method in PUBLISHED if method != "brightness_referenced"]
    words = "{}: comparisons over brightness_referenced's, median"
    return found + [rows.median(words.format(name), condition, of[name] / base) for name in names]


def _ratio(above, below):
    return above.mean() / below.mean()


SHORT = {"brightness_referenced": "brightness", "pyramid": "pyramid", "geometric_voting": "voting"}


def draw_outcomes(figure, rows, conditions):
    """Failed and wrong in each condition: published, simulated, and with each variant; a list is a column."""
    grid = [conditions] if isinstance(conditions[0], str) else conditions
    axes = figure.subplots(len(grid[0]), len(grid), squeeze=False).T
    of = {(row.quantity, row.condition): row for row in rows}
    cells = [(method, outcome) for method in PUBLISHED for outcome in OUTCOMES[1:]]
    variant_of = {whose: name for name, (whose, _, _) in VARIANTS.items()}
    places = np.arange(len(cells))
    for axis, condition in zip(axes.ravel(), [one for column in grid for one in column], strict=True):
        here = [of[f"{method}: {outcome}", condition] for method, outcome in cells]
        other = [of[f"{method}, {variant_of[method]}: {outcome}", condition] for method, outcome in cells]
        axis.bar(places - 0.27, [100.0 * row.published for row in here], 0.26, label="published", color="0.6")
        for k, (found, label) in enumerate(((here, "simulated here"), (other, "simulated, variant"))):
            measured = np.array([row.measured for row in found])
            reach = 100.0 * np.abs(np.array([row.ci95 for row in found]) - measured[:, None]).T
            look = {"color": COLOURS[k], "label": label, "capsize": 2, "error_kw": {"lw": 0.8}}
            axis.bar(places + 0.27 * k, 100.0 * measured, 0.26, yerr=reach, **look)
        axis.set_xticks(places, [f"{SHORT[method]}\n{outcome}" for method, outcome in cells], fontsize=7)
        axis.set_ylabel("per cent")
        axis.set_title(condition.replace("_", " "), fontsize=9)
        tidy(axis)
    axes[0, 0].legend(fontsize=8, frameon=False)


# --- without a clock ---
#
# The paper orders the methods by their times in MATLAB. What of that is the method's own is the number of
# comparisons: two lists of candidates are joined entry by entry, as a program without other tables does. Of a
# list the brightness leaves one way round, where the order is certain; the other methods have both.


def spans(pairs, u_c, tolerance):
    """Catalogue pairs with each angle between detections: (n, n) int."""
    cosines = np.clip(u_c @ u_c.T, -1.0, 1.0)
    angle = np.arccos(cosines)
    low = np.searchsorted(pairs.cosine, np.cos(angle + tolerance))
    return np.searchsorted(pairs.cosine, np.cos(np.maximum(angle - tolerance, 0.0))) - low


def comparisons(settings, pairs, field):
    """Comparisons of the first group that each of the paper's methods tries: dict of method -> int.

    Brightness-referenced: the brightest star with the three dimmest, two lists joined and what is left with
    the third. Pyramid: the first triad in the same way, every entry both ways round. Voting: four votes an
    entry of all pairs, and the validation of all identities.
    """
    n = min(len(field.flux), settings.most_centroids)
    size = spans(pairs, field.u_c[:n], settings.tolerance)
    ratio = 10.0 ** (0.4 * brightness.GAMMA_SIGMAS * settings.magnitude_error)
    ways = [1 if field.flux[0] > ratio * field.flux[k] else 2 for k in range(n)]
    first, second = ways[n - 1] * size[0, n - 1], ways[n - 2] * size[0, n - 2]
    third = ways[n - 3] * size[0, n - 3] if n > 3 else 0
    every = int(np.triu(size, 1).sum())
    sides = 2 * size[0, 1], 2 * size[0, 2]
    return {
        "brightness_referenced": int(first * second + _left(pairs, first, second) * third),
        "pyramid": int(sides[0] * sides[1] + _left(pairs, *sides) * size[1, 2]),
        "geometric_voting": 4 * every + n * (n - 1) // 2,
    }


def _left(pairs, first, second):
    """Candidates that two lists of stars have in common, on average, if they are drawn at random."""
    return 1.0 + first * second / len(pairs.stars.hip)


def mismatch(n_stars, error, angles):
    """Probability that another star has all three angles: equation (15), (N - 1) (N sin k sigma)^3 x sines.

    n_stars : N, stars of the catalogue;  error : float [rad], k sigma;  angles : (..., 3) rad
    """
    return (n_stars - 1) * (n_stars * np.sin(error)) ** 3 * np.prod(np.sin(angles), axis=-1)


def mismatch_of(field, n_stars):
    """The same of a field's brightest star and its three dimmest of ten."""
    n = min(len(field.flux), fields.IDENTIFY.most_centroids)
    cosines = np.clip(field.u_c[n - 3 : n] @ field.u_c[0], -1.0, 1.0)
    return float(mismatch(n_stars, fields.TOLERANCE, np.arccos(cosines)))
