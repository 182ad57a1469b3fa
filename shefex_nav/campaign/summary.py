"""What a campaign says: one object for programs, tables for people."""

from typing import NamedTuple

from rich import box
from rich.console import Group
from rich.table import Table
from rich.text import Text

from shefex_nav.campaign import convergence, over_time, sensitivity, statistics
from shefex_nav.report import intervals
from shefex_nav.report.requirements import severity

RATE_PRECISION = 0.01  # to which 'runs still needed' is told: one point of a success rate,
PERCENTILE_PRECISION = 0.05  # and this share of a percentile
MOST_CAUSES, MOST_RUNS, MOST_WORST, MOST_EXPLAIN = 8, 6, 3, 12  # lines of the tables
CONTAINED = "errors inside 3 sigma at the ends of the phases"


class Worst(NamedTuple):
    """A run to look at."""

    run: int
    severity: float
    words: str  # what it did not meet, or came nearest to


def summary_object(campaign):
    """The object that `campaign --json` and `report DIR --json` print: plain dict, ready for JSON."""
    succeeded = int(campaign.succeeded.sum())
    return {
        "runs": len(campaign),
        "succeeded": succeeded,
        "failed": len(campaign) - succeeded,
        "requirements": [
            {
                "name": one.name,
                "limit": one.limit,
                "unit": one.unit,
                "passed": one.passed,
                "of": one.of,
                "ci95": None if one.ci95 is None else list(one.ci95),
            }
            for one in statistics.successes(campaign)
        ],
        "wall_s": campaign.wall_s,
        "results_digest": campaign.digest,
    }


def worst_runs(campaign, k=MOST_WORST):
    """The k succeeded runs that met the fewest requirements, or came nearest to the limits: list of Worst."""
    runs = campaign.runs[campaign.succeeded].tolist()
    found = [
        Worst(run, severity(judged), _why(judged)) for run, judged in zip(runs, campaign.judged, strict=True)
    ]
    return sorted(found, key=lambda one: (-one.severity, one.run))[:k]


def _why(judged):
    """What a run missed, or what it came nearest to."""
    missed = [one for one in judged if not one.passed]
    nearest = sorted(judged, key=lambda one: -severity([one]))[:1]
    words = ", ".join(f"{_name(one.name)} {_found(one)}" for one in missed or nearest)
    return words if missed else f"all kept; nearest: {words}"


def _found(one):
    if one.found is None:
        return "not measured"
    if isinstance(one.found, bool):
        return "yes" if one.found else "no"
    return f"{one.found:.4g}{' ' if one.unit else ''}{one.unit}"


def _name(name):
    return name.replace("_", " ")


# ---- tables ----------------------------------------------------------------------------------------------


def tables(campaign, series=None):
    """Everything for people: rich Group. series : over_time.Series, or None to leave out what needs it."""
    parts = [_head(campaign), _requirements(campaign), _errors(campaign), _flight(campaign)]
    if series is not None:
        parts += [_covariance(campaign, series)]
    parts += [_failures(campaign), _worst(campaign), _explained(campaign)]
    return Group(*(part for part in parts if part is not None))


def _table(title, *columns):
    """A table without lines between rows; a column whose name begins with '>' is of numbers."""
    table = _plain(title)
    for name in columns:
        table.add_column(name.lstrip(">"), justify="right" if name.startswith(">") else "left")
    return table


def _plain(title, **options):
    return Table(title=title, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, **options)


def _head(campaign):
    n, asked, good = len(campaign), campaign.head["runs"], int(campaign.succeeded.sum())
    low, high = intervals.proportion(good, n)
    table = _plain(f"{campaign.head['scenario']}, seed {campaign.head['seed']}", show_header=False)
    done = f"{n} of {asked}, the campaign is not finished" if n < asked else f"{n}"
    table.add_row("runs", Text(done, style="bold yellow" if n < asked else ""))
    table.add_row("flew to their end", f"{good}, {_percent(good / n)} (95 % interval {_between(low, high)})")
    if n > good:
        table.add_row("failed", Text(str(n - good), style="bold red"))
    if campaign.wall_s:
        table.add_row("took", f"{campaign.wall_s:,.0f} s, {3600.0 * n / campaign.wall_s:,.0f} runs an hour")
    table.add_row("digest of the results", campaign.digest[:16])
    return table


def _percent(share):
    return f"{100.0 * share:.1f} %"


def _between(low, high):
    return f"{100.0 * low:.2f} to {100.0 * high:.2f} %"


def _requirements(campaign):
    found = statistics.successes(campaign)
    if not found:
        return Text("The scenario has no requirements.", style="italic")
    title = "Requirements, of the runs that flew to their end"
    table = _table(
        title, "requirement", "limit", ">passed", ">of", ">rate", ">95 % interval", ">runs more for ±1 point"
    )
    for one in found:
        name = Text(_name(one.name), style="" if one.passed == one.of else "bold yellow")
        if one.ci95 is None:
            table.add_row(name, one.words, "0", "0", "-", "-", "-")
            continue
        still = convergence.needed_for_rate(one.passed, one.of, RATE_PRECISION).still
        rate = _percent(one.passed / one.of)
        without = f"{one.passed} ({one.without} not measured)" if one.without else str(one.passed)
        table.add_row(name, one.words, without, str(one.of), rate, _between(*one.ci95), f"{still:,}")
    return table


def _errors(campaign):
    found = statistics.errors(campaign)
    if not found:
        return None
    names = [f">{percent:g} % (95 % interval)" for percent in statistics.QUANTILES]
    table = _table("Sizes of errors: percentiles over the runs", "error", "unit", *names, ">worst", ">run")
    for one in found:
        cells = [_with_interval(percentile) for percentile in one.percentiles]
        table.add_row(one.name, one.unit, *cells, _short(one.worst), str(one.worst_run))
    return table


def _short(value):
    return f"{value:.3g}" if abs(value) < 1000.0 else f"{value:,.0f}"


def _with_interval(one):
    """`0.12 (0.10 to 0.14)`; an end that the sample is too small for is open."""
    low, high = ("..." if end is None else _short(end) for end in (one.low, one.high))
    return f"{_short(one.value)} ({low} to {high})"


def _flight(campaign):
    """Star tracker and dispersion of the flights."""
    table = _plain("Star tracker and flight", show_header=False)
    star = statistics.star_fixes(campaign)
    if star is not None:
        one = star.availability
        words = f"{one.part:,} of {one.whole:,}, {100.0 * one.value:.2f} %"
        if one.low is not None:
            words += f" (95 % interval over runs {100.0 * one.low:.2f} to {100.0 * one.high:.2f} %)"
        table.add_row("frames of the window solved", words)
        bound = f"at most {_tiny(star.most_wrong_runs)} of runs, {_tiny(star.most_wrong_fixes)} of fixes"
        wrong = f"{star.wrong} in {star.runs_with_wrong.part} of {star.runs_with_wrong.whole} runs; {bound}"
        table.add_row("wrong fixes", Text(f"{wrong} (95 %)", style="bold red" if star.wrong else ""))
    for one in statistics.ellipses(campaign):
        long, short = one.semi_axes_km
        up = one.covariance_km2[2, 2] ** 0.5
        words = (
            f"{long:.3g} by {short:.3g} km, long axis {one.azimuth_deg:.0f} deg from north, about "
            f"{one.latitude_deg:.3f} N {one.longitude_deg:.3f} E; {one.inside} of {one.samples} runs inside; "
            f"height {one.altitude_km:.2f} km, sigma {up:.3g} km"
        )
        table.add_row(f"95 % ellipse at {one.what}", words)
    return table if table.row_count else None


def _tiny(probability):
    """A small probability in per cent with two digits."""
    return f"{100.0 * probability:.2g} %"


def _covariance(campaign, series):
    """Whether the covariance describes the errors."""
    groups = {
        CONTAINED: over_time.judge_containment(series),
        "NEES at the ends of the phases": over_time.judge_nees(series),
        "NIS of the sensors": over_time.judge_nis(series),
    }
    table = _table(
        f"Does the covariance describe the errors? ({len(series.runs)} runs)",
        "judged", ">found", ">expected", ">p (Holm)", "verdict",
    )  # fmt: skip
    for title, verdicts in groups.items():
        bad = [one for one in verdicts if not one.good]
        words = "as chance would have it" if not bad else f"{len(bad)} of {len(verdicts)} are not"
        table.add_row(title, "", "", "", Text(words, style="bold yellow" if bad else "green"))
        for one in sorted(bad, key=lambda one: one.p)[:MOST_EXPLAIN]:
            between = f"{one.low:.3f} to {one.high:.3f}"
            # few inside 3 sigma mean a small covariance, as a large NEES or NIS does
            is_small = one.value > one.high or verdicts is groups[CONTAINED]
            words = "covariance too small" if is_small else "covariance too large"
            table.add_row(f"  {one.what}", f"{one.value:.3f}", between, f"{one.p_holm:.1e}", words)
    table.add_section()
    for block, (value, low, high) in over_time.time_averages(series).items():
        words = "holds 1" if low <= 1.0 <= high else f"covariance too {'small' if low > 1.0 else 'large'}"
        name = f"NEES of {block.replace('_', ' ')} per degree of freedom, all times"
        table.add_row(name, f"{value:.3f}", f"{low:.3f} to {high:.3f}", "", words)
    return table


def _failures(campaign):
    causes = campaign.causes()
    if not causes:
        return None
    table = _table("Why runs failed", ">runs", "reason", "of these", "look at one")
    for cause in causes[:MOST_CAUSES]:
        some = ", ".join(str(run) for run in cause.runs[:MOST_RUNS])
        more = ", ..." if len(cause.runs) > MOST_RUNS else ""
        table.add_row(str(len(cause.runs)), cause.words, some + more, repeat(campaign, cause.runs[0]))
    if len(causes) > MOST_CAUSES:
        table.add_row("", f"and {len(causes) - MOST_CAUSES} other reasons", "", "")
    lines = [
        Text(
            f"Failed runs drew {one.feature} from {one.failed_from:.6g} to {one.failed_to:.6g}, the others "
            f"from {one.others_from:.6g} to {one.others_to:.6g} (p {one.p_holm:.1e})"
        )
        for one in sensitivity.separations(campaign)
        if one.p_holm < sensitivity.SIGNIFICANT
    ]
    return Group(table, *lines[:3])


def repeat(campaign, run):
    """The command that flies a run again."""
    return f"shefex-nav repeat {campaign.folder} {run} --log run{run}.mcap"


def _worst(campaign):
    worst = worst_runs(campaign)
    if not worst or not statistics.successes(campaign):
        return None
    table = _table("Worst of the other runs", ">run", "because of", "look at it")
    for one in worst:
        table.add_row(str(one.run), one.words, repeat(campaign, one.run))
    return table


def _explained(campaign):
    """Which dispersion explains what."""
    found = sensitivity.outcomes(campaign)
    features = sensitivity.features(campaign.draws)
    if not features or not found:
        return None
    all_ranks = sensitivity.ranks(found, features)
    certain = [one for one in all_ranks if one.p_holm < sensitivity.SIGNIFICANT]
    regressed = {one.outcome: one for one in sensitivity.regressions(found, campaign.draws)}
    table = _table(
        "What explains the results (|x|: distance of x from its median)",
        "result", "draw", ">rank correlation", ">p (Holm)", ">sigmas per sigma (95 %)", ">R² of all draws",
    )  # fmt: skip
    for one in certain[:MOST_EXPLAIN]:
        regression = regressed.get(one.outcome)
        cells = ("-", "-") if regression is None else (_effect(regression, one.feature), _r2(regression))
        table.add_row(one.outcome, one.feature, f"{one.rho:+.2f}", f"{one.p_holm:.1e}", *cells)
    if not certain:
        words = f"no draw, of {len(features)} features against {len(found)} results in {len(campaign)} runs"
        table.add_row(words, "", "", "", "", "")
    return table


def _effect(regression, feature):
    for one in regression.effects:
        if one.feature == feature:
            return f"{one.value:+.2f} ({one.low:+.2f} to {one.high:+.2f})"
    return "-"


def _r2(regression):
    return f"{regression.r2_adjusted:.2f} ({regression.r2_low:.2f} to {regression.r2_high:.2f})"
