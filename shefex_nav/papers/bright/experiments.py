"""The experiments of the brightness-referenced paper (BRIGHT, 2014): tables 2, 3 and 4, figures 1 and 3."""

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker import catalogue
from shefex_nav.papers import rows as row
from shefex_nav.papers.bright import centroids, fields, frames, outcomes
from shefex_nav.papers.bright.methods import brightness
from shefex_nav.papers.bright.published import BRIGHT
from shefex_nav.papers.experiment import Experiment
from shefex_nav.papers.picture import COLOURS, tidy
from shefex_nav.papers.rows import count
from shefex_nav.papers.stills import random_attitude
from shefex_nav.papers.verdict import POINTS
from shefex_nav.report import intervals

SITUATIONS = {  # name -> catalogue stars at least, false stars
    "no_false_star": (3, 0),
    "one_false_star_at_least_4_stars": (3, 1),
    "one_false_star_at_least_5_stars": (4, 1),
}
SHAPES = ("square", "round")


# ---------------------------------------------------------------------------------------------- table 2


def measure_counts(samples, seed):
    """Stars per bin of Hp, and the directions of the reference stars. Nothing is random."""
    edges = (3.0, 4.0, 5.0, 6.0, 7.0)
    built = [fields.on_board(limit=edge, merge_px=0.0) for edge in edges]
    counts = np.diff([0, *(len(stars.hip) for stars in built)])
    return dict(zip(BRIGHT["catalogue_counts"], counts.tolist(), strict=True)), built[0].u_i


def conclude_counts(results):
    counts, _ = results[0]
    return [
        count("stars", f"Hp {magnitudes}", published, counts[magnitudes])
        for magnitudes, published in BRIGHT["catalogue_counts"].items()
    ]


def draw_counts(figure, results, rows):
    """Table 2 as bars, and figure 2: the reference stars on the sky."""
    _, u_i = results[0]
    left, right = figure.add_subplot(1, 2, 1), figure.add_subplot(1, 2, 2, projection="mollweide")
    places = np.arange(len(rows))
    left.bar(places - 0.2, [row.published for row in rows], 0.4, label="published")
    left.bar(places + 0.2, [row.measured for row in rows], 0.4, label="counted here")
    left.set_xticks(places, [row.condition for row in rows])
    left.set_yscale("log")
    left.set_ylabel("stars")
    left.legend()
    right.plot(np.arctan2(u_i[:, 1], u_i[:, 0]), np.arcsin(u_i[:, 2]), ".", ms=4)
    right.set_title(f"{len(u_i)} reference stars (figure 2)")
    right.set_xticklabels([])  # they would lie upon the stars and each other
    right.grid(True, alpha=0.3)


# ---------------------------------------------------------------------- section 4.1, figure 3, figure 4


def measure_brightest(samples, seed):
    """Stars in view, Hp of the brightest, third dimmest less brightest of ten, of all, stars in the circle:
    (samples, 5). The circle is that around the field.
    """
    rng, stars = np.random.default_rng(seed), fields.pairs()[0].stars
    table = np.full((samples, 5), np.nan)
    for k in range(samples):
        q_ic = random_attitude(rng)
        rows, _ = fields.in_view(stars, q_ic, False)
        table[k, 4] = (stars.u_i @ dcm_from_quat(q_ic)[:, 2] > COS_AROUND).sum()
        every = np.sort(stars.vmag[rows])
        magnitudes = every[: BRIGHT["protocol"]["brightest_used"]]
        table[k, 0] = len(rows)
        if len(rows) >= 4:
            table[k, 1:4] = magnitudes[0], magnitudes[-3] - magnitudes[0], every[-3] - every[0]
    return table


def conclude_brightest(results):
    """Share of the fields with four stars, and what the brightest is to the third dimmest."""
    table = np.vstack(results)
    seen, n = table[table[:, 0] >= 4], len(table)
    four, published = FOUR, BRIGHT["brightest_star"]
    gamma = brightness.GAMMA_SIGMAS * fields.MAGNITUDE_SIGMA
    wanted = published["mean_difference_to_third_dimmest_mag"]

    def mean_row(words, values):
        interval = intervals.mean(values) if len(values) > 1 else None
        given = f"third dimmest of {words} less brightest [mag], mean", four, wanted, float(values.mean())
        return row.figure(*given, interval, len(values), rounding=0.005, resolves=0.1)

    ten, every = mean_row("ten", seen[:, 2]), mean_row("all", seen[:, 3])
    run, words = "bright-brightest/all stars", "how many stars a frame may have is not said; with all of them"
    wanted = published["within_magnitude_accuracy"]
    certain, certain_of_all = (
        row.published_share(
            "order of brightness certain", f"third dimmest of {of} above {gamma:.1f} mag, three sigma",
            wanted, (seen[:, column] > gamma).sum(), len(seen), n_published=10000,
        )
        for of, column in (("ten", 2), ("all", 3))
    )  # fmt: skip
    k_bright = int((seen[:, 1] < BRIGHT["protocol"]["reference_star_mag"]).sum())
    given = k_bright / len(seen), intervals.proportion(k_bright, len(seen)), len(seen)
    most = {"least": np.nextafter(0.5, 1.0), "resolves": POINTS}
    return [
        *_four_rows(table),
        row.explained(ten, every, run, words, passes=True),
        row.variant(every),
        row.variant(certain),
        row.calibrated(certain_of_all),  # gamma is three sigma because of this figure
        row.statement("a reference star, Hp < 3; published: most", four, None, *given, **most),
        _mismatch_row(n),
        _pair_row(),
    ]  # fmt: skip


def _four_rows(table):
    """Images with four stars, in the square field and in the circle around it. (n, 5)"""
    n, condition = len(table), "Hp < 5, random attitudes"
    shown, around = (
        row.published_share(FOUR, f"{condition}{words}", 1.0, (table[:, k] >= 4).sum(), n, n_published=10000)
        for words, k in (("", 0), (", circle around the field", 4))
    )
    run, words = (
        "bright-brightest/circle around the field",
        "of stars nearer to the boresight than the corners",
    )
    return [row.explained(shown, around, run, words), row.variant(around)]


FOUR = "images with at least four stars"


def _mismatch_row(n):
    """Equation (15), of random fields: the paper has it 'in most instances' at 0.01 or below."""
    rng, stars = np.random.default_rng(MISMATCH_SEED), fields.pairs()[0].stars
    drawn = [fields.draw_field(rng, stars, least=4, n_false=0, is_round=False) for _ in range(min(n, 1000))]
    small = sum(outcomes.mismatch_of(field, len(stars.hip)) <= RHO_MIS for field in drawn)
    given = small / len(drawn), intervals.proportion(small, len(drawn)), len(drawn)
    quantity = "mismatch by equation (15) at most 0.01; published: most"
    most = {"least": np.nextafter(0.5, 1.0), "resolves": POINTS}
    return row.statement(quantity, "brightest star with the three dimmest", None, *given, **most)


RHO_MIS, MISMATCH_SEED = 0.01, 15
PAIRS = 44234  # section 4.2.2, of the 1604 stars of the Bright Star Catalogue
PAIR_STARS = 1604
PAIR_CHOICES, PAIR_SEED, PAIR_RESOLVES = 1000, 16, 0.005  # the last: share of a count that counts as the same
# the corners of a field with tangents of 10 deg for half sides are 14.00 deg away, of angles of 10 deg 14.14
COS_AROUND = np.cos(np.radians(0.5 * np.hypot(*BRIGHT["camera"]["fov_deg"])))


def _pair_row():
    """Pairs of as many stars as the paper took.

    Its list has 1604 stars to V 5, Hipparcos 1608. Which four the Bright Star Catalogue has not, or fainter,
    is not known here: any four are left out, again and again, and the interval is that of the choice.
    """
    stars, rng = fields.on_board("V", merge_px=0.0), np.random.default_rng(PAIR_SEED)
    pairs = catalogue.pair_table(stars, np.radians(BRIGHT["camera"]["fov_deg"][0]))
    counts = np.empty(PAIR_CHOICES)
    for k in range(PAIR_CHOICES):
        is_out = np.zeros(len(stars.hip), dtype=bool)
        is_out[rng.choice(len(is_out), len(is_out) - PAIR_STARS, replace=False)] = True
        counts[k] = (~(is_out[pairs.first] | is_out[pairs.second])).sum()
    condition = f"any {PAIR_STARS} of the {len(stars.hip)} stars to V 5 in Hipparcos, mean of {PAIR_CHOICES}"
    interval = tuple(float(end) for end in np.percentile(counts, [2.5, 97.5]))
    how = {"resolves": PAIR_RESOLVES * PAIRS, "rounding": 0.5}
    return row.figure(
        "pairs within 20 deg", condition, PAIRS, float(counts.mean()), interval, PAIR_CHOICES, **how
    )


# ---------------------------------------------------------------------------------------------- table 3


def measure_table3(samples, seed):
    """Outcome and time of each method in each situation, for both shapes of the field.

    Returns
    -------
    dict of shape -> (n_stars (3, samples), outcome (3, methods, samples), seconds (3, methods, samples),
        comparisons (3, paper's methods, samples))
    """
    rng, tables = np.random.default_rng(seed), fields.pairs()
    stars = tables[0].stars
    warm = fields.draw_field(np.random.default_rng(0), stars, least=6, n_false=1, is_round=False)
    outcomes.attempt(
        fields.IDENTIFY, fields.REFERENCE_FLUX, tables, warm
    )  # compiles, and fetches the tables into the cache
    results = {}
    for shape in SHAPES:
        n_stars = np.zeros((len(SITUATIONS), samples), dtype=np.int16)
        outcome = np.zeros((len(SITUATIONS), len(outcomes.TRIED), samples), dtype=np.int8)
        seconds = np.zeros(outcome.shape)
        counted = np.zeros((len(SITUATIONS), len(outcomes.PUBLISHED), samples), dtype=np.int64)
        for s, (least, n_false) in enumerate(SITUATIONS.values()):
            for k in range(samples):
                is_round = shape == "round"
                field = fields.draw_field(rng, stars, least=least, n_false=n_false, is_round=is_round)
                n_stars[s, k] = (field.star >= 0).sum()
                outcome[s, :, k], seconds[s, :, k] = outcomes.attempt(
                    fields.IDENTIFY, fields.REFERENCE_FLUX, tables, field
                )
                compared = outcomes.comparisons(fields.IDENTIFY, tables[0], field)
                counted[s, :, k] = [compared[method] for method in outcomes.PUBLISHED]
        results[shape] = n_stars, outcome, seconds, counted
    return results


def conclude_table3(results):
    """Table 3 for both shapes of the field; times and comparisons of the square one."""
    found = {shape: _shape_rows(results, shape) for shape in SHAPES}
    round_rows = {one.quantity + one.condition: one for one in found["round"]}
    words = "in a round field 20 deg across, which shows so few stars as often as the paper says"
    square = []
    for one in found["square"]:
        other = round_rows.get(one.quantity + one.condition.replace("square", "round"))
        square.append(one if other is None else row.explained(one, other, "bright-table3/round field", words))
    return [*square, *found["round"]]


def _shape_rows(results, shape):
    n_stars = np.concatenate([result[shape][0] for result in results], axis=1)
    outcome = np.concatenate([result[shape][1] for result in results], axis=2)
    seconds = np.array([result[shape][2].mean(axis=2) for result in results])  # a row a chunk
    counted = np.concatenate([result[shape][3] for result in results], axis=2)
    found = few_star_rows(n_stars, shape)
    for s, situation in enumerate(SITUATIONS):
        condition, published = f"{situation}, {shape} field", BRIGHT["table3"][situation]
        found += outcomes.method_rows("bright-table3", condition, outcome[s], published, 10000)
        if shape == "square":  # ours is told the shape of the detector, which is square
            for method, codes in zip(outcomes.METHODS, outcome[s], strict=False):
                if method in outcomes.OWN:
                    found += outcomes.own_rows(condition, method, codes, n_stars[s])
            found += outcomes.time_rows(condition, seconds[:, s], published)
            found += outcomes.comparison_rows(condition, counted[s])
    return found


# Section 5.1 counts, among 10 000, '140 cases where there are four stars' with the false one, and '478 five
# stars cases', read as five true stars: with the false one it would be 3.0 per cent of the round fields.
FEW_STARS = ((1, 3, 140), (2, 5, 478))


def few_star_rows(n_stars, shape):
    """How often there are so few stars."""
    rows = []
    for s, n_true, published in FEW_STARS:
        condition = f"{list(SITUATIONS)[s]}, {shape} field"
        given = f"images with {n_true} catalogue stars", condition, published / 1e4
        k = (n_stars[s] == n_true).sum()
        rows.append(row.published_share(*given, k, n_stars.shape[1], n_published=10000))
    return rows


def draw_table3(figure, results, rows):
    """Failures and wrong identifications of each method in each situation, beside the published ones."""
    figure.set_size_inches(12.0, 8.5)
    shapes = [[f"{situation}, {shape} field" for situation in SITUATIONS] for shape in SHAPES]
    outcomes.draw_outcomes(figure, rows, shapes)


def draw_brightest(figure, results, rows):
    """Figure 3, the brightest star; the third dimmest; figure 4, P by index; figure 7, stars by light."""
    table = np.vstack(results)
    seen = table[table[:, 0] >= 4]
    figure.set_size_inches(11.0, 8.0)
    (brightest, third), (ascending, light) = figure.subplots(2, 2)
    brightest.hist(seen[:, 1], bins=np.arange(-1.5, 5.01, 0.25), color=COLOURS[0])
    brightest.set_xlabel("Hp of the brightest star (figure 3)")
    for column, words, colour in ((2, "of ten", COLOURS[0]), (3, "of all", COLOURS[1])):
        third.hist(seen[:, column], np.arange(0.0, 6.01, 0.2), histtype="step", color=colour, label=words)
    published = next(row.published for row in rows if row.quantity.startswith("third dimmest"))
    third.axvline(published, color="0.3", ls=":", label="mean, published")
    third.set_xlabel("third dimmest less brightest [mag]")
    third.legend(frameon=False)
    for axis in (brightest, third):
        axis.set_ylabel("images")
    pairs = fields.pairs()[0]
    ascending.plot(np.arange(1, len(pairs.cosine) + 1), pairs.cosine, color=COLOURS[0])
    ascending.set(xlabel=f"index, of {len(pairs.cosine)} pairs (figure 4)", ylabel="P, cosine of the angle")
    flux = 10.0 ** (-0.4 * np.sort(pairs.stars.vmag))
    light.semilogy(np.arange(1, len(flux) + 1), flux, ".", ms=3, color=COLOURS[0])
    light.set(xlabel="stars by brightness (figure 7)", ylabel="light, 1 at magnitude 0")
    for axis in (brightest, third, ascending, light):
        tidy(axis)


EXPERIMENTS = {
    "bright-table2": Experiment(
        samples=1,
        unit="catalogues",
        chunk=1,
        measure=measure_counts,
        conclude=conclude_counts,
        draw=draw_counts,
    ),
    "bright-brightest": Experiment(
        samples=10000,
        unit="attitudes",
        chunk=1000,
        measure=measure_brightest,
        conclude=conclude_brightest,
        draw=draw_brightest,
    ),
    "bright-table3": Experiment(
        samples=10000,
        unit="orientations",
        chunk=250,
        measure=measure_table3,
        conclude=conclude_table3,
        draw=draw_table3,
        timed=True,
    ),
    "bright-table4": Experiment(
        samples=1000,
        unit="frames",
        chunk=50,
        measure=frames.measure_table4,
        conclude=frames.conclude_table4,
        draw=frames.draw_table4,
        timed=True,
    ),
    "bright-centroids": Experiment(
        samples=200,
        unit="tracks",
        chunk=20,
        measure=centroids.measure_centroids,
        conclude=centroids.conclude_centroids,
        draw=centroids.draw_centroids,
    ),
}
