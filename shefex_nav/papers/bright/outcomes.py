"""The methods that BRIGHT compares, and ours; how they are judged, and the rows of tables 3 and 4."""

from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np

from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.papers import rows
from shefex_nav.papers.bright.fields import MODEL, VOTING_TOLERANCE
from shefex_nav.papers.bright.methods import brightness, voting
from shefex_nav.papers.experiment import Row
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.verdict import POINTS
from shefex_nav.records import Reason
from shefex_nav.report import intervals

SUCCESS, FAILED, WRONG = 0, 1, 2
REPEATS = 3
TIME_RESOLVES = 0.25  # of a ratio of times beside one: what tells which is the longer
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

FEW_SQUARE = (
    "a square field of 20 x 20 deg at random attitudes hardly ever shows so few stars; a round one, 20 deg "
    "across, does as often as the paper says"
)
FEW_ROUND = "not explained: the share in random round fields has other values"
# Why a share differs: the first entry whose words are all in the condition and the name of the method. What
# is said of other tolerances was measured with 3000 round fields each, the comparisons below with 396 fields.
REASONS = (
    (
        ("rendered", "voting"),
        "the false stars that defeat voting in orbit, as many as true ones, are not in these frames",
    ),
    (
        ("square",),
        "a square field rarely has as few as three or four stars, where nearly all misses are; a round "
        "field, which has them as often as the paper, is closer",
    ),
    (
        ("4_stars", "pyramid"),
        "not explained: a closed triangle of the catalogue that holds the false star is too rare for 75 "
        "wrong of 140, even with a tolerance of 60 arcsec (2 of 40)",
    ),
    (
        ("5_stars", "voting"),
        "the misses grow with the tolerance, which the paper does not give: 0.1 per cent at 15 arcsec, as "
        "here, 2.3 at 30",
    ),
    (
        ("voting",),
        "the papers do not describe the clustering; here three identities must agree, so that votes that "
        "tie, as they do with three stars, end as failed and not as wrong",
    ),
    (
        ("5_stars", "brightness"),
        "the failures grow with a smaller tolerance: 0.04 per cent at 7 arcsec, as here, 0.8 at 5; and all "
        "angles of a candidate must fit here, where the paper does not say which",
    ),
    (
        ("brightness",),
        "all angles of a candidate must fit here; the paper does not say which it checks",
    ),
)
TIME_REASON = (
    "here candidates are joined by star in a time proportional to their number, so that narrowing them saves "
    "little; entry by entry, the first angles would take 3.8 times fewer comparisons than the pyramid's"
)


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
    outcome, seconds = np.zeros(len(METHODS), dtype=np.int8), np.full(len(METHODS), np.inf)
    for m, (name, method) in enumerate(METHODS.items()):
        pairs = tables[0 if name in PUBLISHED else 1]
        more = {"reference_flux": reference_flux} if method is brightness.match else {}
        for _ in range(REPEATS):
            began = perf_counter()
            found = method(settings, MODEL, pairs, field.u_c, field.flux, **more)
            seconds[m] = min(seconds[m], perf_counter() - began)
        outcome[m] = judge(found, field.star)
    return outcome, seconds


def share_row(quantity, condition, published, k, n, n_published, why):
    """A share beside a published one, which has a sampling error too; they agree if the intervals meet."""
    least, most = intervals.proportion(round(published * n_published), n_published)
    criterion = {"least": least, "most": most, "resolves": POINTS, "refuted": True}
    return rows.judged_share(quantity, condition, published, k, n, why, **criterion)


def outcome_rows(condition, method, codes, published, n_published):
    """Success, failed and wrong of one of the paper's methods."""
    shares = (published["success"], published["failed"] / n_published, published["wrong"] / n_published)
    found = []
    for code, (outcome, share) in enumerate(zip(OUTCOMES, shares, strict=True)):
        k, why = int((codes == code).sum()), reason(condition, method)
        found.append(share_row(f"{method}: {outcome}", condition, share, k, len(codes), n_published, why))
    return found


def own_rows(condition, method, codes, n_stars):
    """Of one of our methods: success where there are four catalogue stars, and wrong of all."""
    possible = codes[n_stars >= 4]
    k_success, k_wrong = int((possible == SUCCESS).sum()), int((codes == WRONG).sum())
    four = f"{condition}, four catalogue stars"
    return [
        rows.share(f"{method}: success", four, k_success, len(possible)),
        rows.share(f"{method}: wrong", condition, k_wrong, len(codes)),
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
        criterion = {"least": np.nextafter(1.0, 2.0), "resolves": TIME_RESOLVES}  # the order, not the factor
        found.append(rows.judged(quantity, condition, wanted, measured, interval, TIME_REASON, **criterion))
    return found


def _ratio(above, below):
    return above.mean() / below.mean()


def reason(condition, method):
    """Why the measured share differs."""
    for words, text in REASONS:
        if all(word in f"{condition} {method}" for word in words):
            return text
    return "not explained"


def draw_outcomes(figure, rows, conditions):
    """Failed and wrong in each condition, published and measured with its interval."""
    axes = figure.subplots(len(conditions), 1, squeeze=False)[:, 0]
    for axis, condition in zip(axes, conditions, strict=True):
        shown = [
            row for row in rows
            if row.condition == condition and row.quantity.endswith(("failed", "wrong"))
            and row.published is not None
        ]  # fmt: skip
        places = np.arange(len(shown))
        measured = np.array([row.measured for row in shown])
        reach = np.abs(np.array([row.ci95 for row in shown]) - measured[:, None]).T
        axis.bar(places - 0.2, [100.0 * row.published for row in shown], 0.4, label="published")
        axis.bar(places + 0.2, 100.0 * measured, 0.4, yerr=100.0 * reach, capsize=3, label="measured")
        axis.set_xticks(places, [row.quantity.replace(": ", "\n") for row in shown], fontsize=7)
        axis.set_ylabel("per cent")
        axis.set_title(condition.replace("_", " "), fontsize=9)
    axes[0].legend()
