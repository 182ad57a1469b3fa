"""What a campaign says to people: tables and lines, of which the terminal's report and the page are made."""

import math

from shefex_nav.campaign import convergence, integrity, over_time, sensitivity, statistics, verdicts
from shefex_nav.campaign.summary import repeat, worst_runs
from shefex_nav.campaign.tables import Bold, Command, Part
from shefex_nav.report import innovations, intervals
from shefex_nav.report.requirements import NO_LEVELS, name_of
from shefex_nav.report.table import place

RATE_PRECISION = 0.01  # to which 'runs still needed' is told: one point of a success rate,
PERCENTILE_PRECISION = 0.05  # and this share of a percentile
MOST_CAUSES, MOST_RUNS, MOST_EXPLAIN, MOST_SEPARATIONS, MOST_VERDICTS = 8, 6, 12, 3, 12
MOST_LOST = 5


def parts(campaign, series=None):
    """Everything for people: list of Part. series : over_time.Series, None if no run has any"""
    found = [
        head(campaign),
        requirements(campaign),
        verdicts.part(campaign),
        errors(campaign),
        flights(campaign),
    ]
    found.append(unjudged(campaign) if series is None else covariance(campaign, series))
    found += [
        trusted(campaign),
        programme(campaign),
        failures(campaign),
        worst(campaign),
        explained(campaign),
    ]
    return [part for part in found if part is not None]


def head(campaign):
    """How many runs, and what they took."""
    n, asked, good = len(campaign), campaign.head["runs"], int(campaign.succeeded.sum())
    done = Bold(f"{n} of {asked}, the campaign is not finished") if n < asked else str(n)
    rate = f"{good}, {_percent(good / n)} (95 % interval {_between(*intervals.proportion(good, n))})"
    rows = [("runs", done), ("flew to their end", rate)]
    if n > good:
        rows.append(("failed", Bold(n - good)))
    for run, reason in list(campaign.lost.items())[:MOST_LOST]:
        rows.append((f"run {run} was lost", Bold(reason)))
    if campaign.wall_s:
        timed = campaign.head.get("timed", {"runs": 0})
        pace = f", {3600.0 * timed['runs'] / timed['wall_s']:,.0f} runs an hour" if timed["runs"] else ""
        rows.append(("took", f"{campaign.wall_s:,.0f} s{pace}"))
    rows.append(("digest of the results", campaign.digest[:16]))
    return Part(f"{campaign.head['scenario']}, seed {campaign.head['seed']}", (), tuple(rows))


def requirements(campaign):
    """Success against each requirement."""
    found = statistics.successes(campaign)
    title = "Requirements, of the runs that flew to their end"
    if not found:
        return Part(title, lines=("The scenario has no requirements.",))
    heads = ("requirement", "limit", ">passed", ">of", ">rate", ">95 % interval", ">runs more for ±1 point")
    n, rows, unjudged = len(campaign), [], []
    failed = n - int(campaign.succeeded.sum())
    if failed:  # a run that failed met nothing that anybody saw
        heads += (f">of all {n} runs",)
    for one in found:
        name = name_of(one.name) if one.passed == one.of else Bold(name_of(one.name))
        if one.ci95 is None and n > failed:  # of software of a user's own
            unjudged.append(name_of(one.name))
            rows.append((unjudged[-1], one.words, *"-----", *(["-"] if failed else [])))
            continue
        if one.ci95 is None:
            rows.append((name, one.words, "0", "0", "-", "-", "-", *(["0.0 %"] if failed else [])))
            continue
        still = convergence.needed_for_rate(one.passed, one.of, RATE_PRECISION).still
        passed = f"{one.passed} ({one.without} not measured)" if one.without else str(one.passed)
        rate = _percent(one.passed / one.of)
        row = (name, one.words, passed, str(one.of), rate, _between(*one.ci95), f"{still:,}")
        rows.append((*row, *([_percent(one.passed / n)] if failed else [])))
    lines = [f"Of all runs: the {failed} that failed count as not passed."] if failed else []
    if unjudged:
        lines.append(f"Cannot be judged, {NO_LEVELS}: {', '.join(unjudged)}.")
    return Part(title, heads, tuple(rows), tuple(lines))


def errors(campaign):
    """Percentiles of the sizes of errors."""
    found = statistics.errors(campaign)
    if not found:
        return None
    names = (f">{percent:g} %" for percent in statistics.QUANTILES)
    heads = ("error", "unit", ">runs", *names, ">worst", ">run", ">runs to add")
    rows = tuple(
        (
            one.name,
            one.unit,
            f"{one.samples:,}",
            *(_with_interval(percentile) for percentile in one.percentiles),
            _short(one.worst),
            str(one.worst_run),
            _still(one),
        )
        for one in found
    )
    lines = ["Runs to add: until the 95 % percentile is known to 5 % of itself."]
    if fewer := sum(one.samples < len(campaign) for one in found):
        which = "all errors" if fewer == len(found) else "some errors"
        lines.append(
            f"Of {which} there are fewer than {len(campaign):,} runs: the others failed, or have none."
        )
    return Part("Sizes of errors: percentiles over the runs, with 95 % intervals", heads, rows, tuple(lines))


def _still(spread):
    """Runs that the 95 % percentile still takes."""
    now = spread.percentiles[statistics.QUANTILES.index(95.0)]
    if not now.value > 0.0:
        return "-"
    needed = convergence.needed_for_percentile(now, spread.samples, PERCENTILE_PRECISION * now.value)
    return f"{'≥ ' if needed.half_width == math.inf else ''}{needed.still:,}"


def flights(campaign):
    """Star tracker, and dispersion of the flights."""
    rows = []
    star = statistics.star_fixes(campaign)
    if star is not None:
        one = star.availability
        words = f"{one.part:,} of {one.whole:,}, {100.0 * one.value:.2f} %"
        if one.low is not None:
            words += f" (95 % interval over runs {_between(one.low, one.high)})"
        elif one.part == one.whole:
            words += f"; at most {_tiny(star.most_gaps)} of runs have one that is not (95 %)"
        rows.append(("frames of the window solved", words))
        bound = f"at most {_tiny(star.most_wrong_runs)} of runs, {_tiny(star.most_wrong_fixes)} of fixes"
        share = star.runs_with_wrong
        alone = "" if star.wrong else ", if those of a run had nothing in common"
        wrong = f"{star.wrong} in {share.part} of {share.whole} runs; {bound}{alone} (95 %)"
        rows.append(("wrong star fixes", Bold(wrong) if star.wrong else wrong))
    for one in statistics.ellipses(campaign):
        long, short = one.semi_axes_km
        words = (
            f"{long:.3g} by {short:.3g} km, long axis {one.azimuth_deg:.0f} deg from north, about "
            f"{place(one._asdict(), 3)}; {one.inside} of {one.samples} runs inside; "
            f"height {one.altitude_km:.2f} km, sigma {one.covariance_km2[2, 2] ** 0.5:.3g} km"
        )
        if one.shape is not None and not one.shape.normal:
            words += f"; {_odd(one.shape)}: use the count of runs inside, not 95 %"
        rows.append((f"95 % ellipse at {one.what}", words))
    return Part("Star tracker and flight", (), tuple(rows)) if rows else None


def _odd(shape):
    """What speaks against a normal dispersion."""
    skew = f"skewness {shape.skewness:.2f}, p {shape.p_skewness:.1g}"
    return f"not normal ({skew}; kurtosis {shape.kurtosis:.2f}, p {shape.p_kurtosis:.1g}; normal: 0 and 8)"


NOTHING_TO_JUDGE = "nothing to judge: the software gives none"
DESCRIBED = "Does the covariance describe the errors?"
CHANCE = "as chance would have it"
CONTAINED = "errors inside 3 sigma at the ends of the phases"


def unjudged(campaign):
    """That the covariance cannot be judged; None if no run flew to its end, which is said elsewhere."""
    good = int(campaign.succeeded.sum())
    if not good:
        return None
    who = "The run has" if good == 1 else f"All {good} runs have"
    return Part(DESCRIBED, lines=(f"{who} no series that could be read: nothing is said of it.",))


def covariance(campaign, series):
    """Whether the covariance describes the errors."""
    groups = {
        CONTAINED: over_time.judge_containment(series),
        "NEES at the ends of the phases": over_time.judge_nees(series),
        "NIS of the sensors": over_time.judge_nis(series, innovations.fixes_last(campaign.head["source"])),
    }
    rows = []
    for title, several in groups.items():
        certain = sorted((one for one in several if one.certain), key=lambda one: (one.good, one.p))
        rows.append((title, "", "", "", _together(several)))
        rows += [_verdict(one, title) for one in certain[:MOST_VERDICTS]]
        if len(certain) > MOST_VERDICTS:
            rows.append((f"  and {len(certain) - MOST_VERDICTS} more", "", "", "", ""))
    for block, (value, low, high) in over_time.time_averages(series).items():
        words = CHANCE if low <= 1.0 <= high else _size(low > 1.0)
        name = f"NEES of {block.replace('_', ' ')} per degree of freedom, all times (99 % interval)"
        rows.append((name, f"{value:.3f} ({low:.3f} to {high:.3f})", "1", "", words))
    good = int(campaign.succeeded.sum())
    some = f"{len(series.runs)} of " if len(series.runs) < good else ""
    lines = (f"{series.unread} runs have no series that could be read.",) if series.unread else ()
    title = f"{DESCRIBED} ({some}{good} runs)"
    return Part(title, ("judged", ">found", ">expected", ">p (Holm)", "verdict"), tuple(rows), lines)


def _together(verdicts):
    """What verdicts of a kind say together."""
    if not verdicts:
        return NOTHING_TO_JUDGE
    bad, off = sum(not one.good for one in verdicts), sum(one.good and one.certain for one in verdicts)
    if not bad + off:
        return CHANCE
    small = f"{off} of {len(verdicts)} {_off()}" if off else ""
    if not bad:
        return small
    return Bold(f"{bad} of {len(verdicts)} are not as they should be" + (f", {small}" if small else ""))


def _off():
    return f"off by less than {100.0 * over_time.PRACTICAL:.0f} %"


def _verdict(one, group):
    """Row of a verdict that chance does not explain.

    Few inside 3 sigma mean a small covariance, as a large NEES does.
    """
    words = _off() if one.good else _size(one.value > one.high or group == CONTAINED)
    return f"  {one.what}", f"{one.value:.3f}", f"{one.low:.3f} to {one.high:.3f}", f"{one.p_holm:.1e}", words


def _size(is_small):
    return Bold(f"covariance too {'small' if is_small else 'large'}")


def trusted(campaign):
    """Integrity risk; None without protection levels."""
    found = integrity.count(campaign)
    if not found:
        return None
    heads = (
        "quantity", ">usable [h]", ">events", ">per hour (99 %)", ">stated", "verdict", ">worst", ">run",
        ">extrapolated, per hour (99 %)",
    )  # fmt: skip
    rows = []
    for one in found:
        verdict = Bold(one.verdict) if one.verdict == "not kept" else one.verdict
        rate = "-" if one.rate is None else f"{one.rate:.2g} ({one.least:.2g} to {one.most:.2g})"
        worst = ("-", "-") if one.worst is None else (f"{one.worst:.2f}", str(one.worst_run))
        tail = "-" if one.tail is None else f"{one.tail:.1g} (at most {one.tail_most:.1g})"
        hours, stated = f"{one.hours:.3g}", f"{one.risk:.2g}"
        rows.append((one.quantity, hours, str(one.events), rate, stated, verdict, *worst, tail))
    lines = (
        "Events: error beyond its protection level for more than a second while usable. Worst: largest error "
        "over its level. Bounds allow for several events in one run; without any event they assume that "
        "each comes alone. Extrapolated: a Gumbel tail of the runs' largest, not counted.",
    )
    return Part("Integrity risk", heads, tuple(rows), lines)


def programme(campaign):
    """What the scenario gets wrong of the dispersed flights; None if nothing."""
    good, lines = int(campaign.succeeded.sum()), []
    for cause in campaign.warnings():
        what = "" if len(cause.runs) == 1 else f", with the numbers of run {cause.runs[0]}"
        lines.append(Bold(f"{len(cause.runs)} of {good} runs ({_some(cause.runs)}){what}: {cause.words}"))
    return Part("The scenario does not fit the flight", lines=tuple(lines)) if lines else None


def _some(runs):
    """The first of some runs."""
    return ", ".join(str(run) for run in runs[:MOST_RUNS]) + (", ..." if len(runs) > MOST_RUNS else "")


def failures(campaign):
    """Why runs failed, and what they have in common."""
    causes = campaign.causes()
    if not causes:
        return None
    lines = []
    for cause in causes[:MOST_CAUSES]:
        count = f"{len(cause.runs)} run{'s' if len(cause.runs) > 1 else ''}"
        lines += [f"{count} ({_some(cause.runs)}): {cause.words}", Command(repeat(campaign, cause.runs[0]))]
    if len(causes) > MOST_CAUSES:
        lines.append(f"and {len(causes) - MOST_CAUSES} other reasons")
    certain = [one for one in sensitivity.separations(campaign) if one.p_holm < sensitivity.SIGNIFICANT]
    for one in certain[:MOST_SEPARATIONS]:
        failed = f"from {one.failed_from:.6g} to {one.failed_to:.6g}"
        others = f"from {one.others_from:.6g} to {one.others_to:.6g}"
        lines.append(f"Failed runs drew {one.feature} {failed}, the others {others} (p {one.p_holm:.1e})")
    return Part("Why runs failed", lines=tuple(lines))


def worst(campaign):
    """Runs to look at."""
    if not statistics.successes(campaign):
        return None
    lines, title = [], "The worst runs"
    if not campaign.succeeded.all():
        title += " of those that flew to their end"
    for one in worst_runs(campaign):
        lines += [f"run {one.run}: {one.words}", Command(repeat(campaign, one.run))]
    return Part(title, lines=tuple(lines)) if lines else None


def explained(campaign):
    """Which dispersion explains what."""
    found, features = sensitivity.outcomes(campaign), sensitivity.features(sensitivity.drawn(campaign))
    if not features or not found:
        return None
    certain = [
        one for one in sensitivity.ranks(found, features) if one.p_holm < sensitivity.SIGNIFICANT
    ]  # fmt: skip
    regressed = {one.outcome: one for one in sensitivity.regressions(found, sensitivity.drawn(campaign))}
    title = "What explains the results (|x|: distance of x from its median)"
    if (used := min(len(campaign), sensitivity.MOST_RUNS)) < len(campaign):
        title += f", the first {used:,} runs"
    if not certain:
        words = (
            f"None is certain: {len(features)} features, {len(found)} results, {used} runs, "
            "at 5 % for all of these pairs together."
        )
        return Part(title, lines=(words,))
    heads = (
        "result",
        "draw",
        ">rank correlation",
        ">p (Holm)",
        ">sigmas per sigma (95 %)",
        ">R² of all draws",
    )
    rows = []
    for one in certain[:MOST_EXPLAIN]:
        regression = regressed.get(one.outcome)
        cells = ("-", "-") if regression is None else (_effect(regression, one.feature), _r2(regression))
        rows.append((one.outcome, one.feature, f"{one.rho:+.2f}", f"{one.p_holm:.1e}", *cells))
    more, lines = len(certain) - MOST_EXPLAIN, []
    if more > 0:
        lines.append(f"and {more} more that are certain")
    if not regressed:
        lines.append("Too few runs for a regression on all draws.")
    elif not all(one.distances for one in regressed.values()):
        lines.append("R² without the distances |x|: runs are too few for a regression on these, too.")
    return Part(title, heads, tuple(rows), tuple(lines))


def _effect(regression, feature):
    for one in regression.effects:
        if one.feature == feature:
            return f"{one.value:+.2f} ({one.low:+.2f} to {one.high:+.2f})"
    return "-"


def _r2(regression):
    return f"{regression.r2:.2f} ({regression.r2_low:.2f} to {regression.r2_high:.2f})"


def _percent(share):
    return f"{100.0 * share:.1f} %"


def _between(low, high):
    return f"{100.0 * low:.2f} to {100.0 * high:.2f} %"


def _tiny(probability):
    """A small probability in per cent with two digits; of None, which nothing was tried for, a word."""
    if probability is None:
        return "any share"
    return f"{100.0 * probability:.2g} %"


def _short(value):
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:,.0f}"


def _with_interval(one):
    """`0.12 (0.10 to 0.14)`; an end that the sample is too small for is open."""
    low, high = ("..." if end is None else _short(end) for end in (one.low, one.high))
    return f"{_short(one.value)} ({low} to {high})"
