"""The result of `rare` for people and as plain values."""

import math

from shefex_nav.campaign.plan import writable
from shefex_nav.campaign.rare import FAILED, LEFT_OUT, in_common, is_of_flight
from shefex_nav.campaign.rare_events import QUANTITIES
from shefex_nav.report import columns

NO_BETTER = 0.15  # share of steps accepted, below which a chain finds little more than independent draws do
FEW = 200  # flights of a level: of fewer, fewer intervals than 95 % hold the truth
MOST_DRAWS = 3  # of a flight that are told
MOST_COMMON, COMMON = 5, 0.5  # means of draws that are told; standard deviations from 0
SIDES = {1: ">", -1: "<"}


def words(event, limit=None):
    """`apogee < 150 km`. limit : in place of the event's, SI"""
    of = QUANTITIES[event.name]
    number = (event.limit if limit is None else limit) * of.factor
    return f"{event.name} {SIDES[event.sign]} {number:.6g} {of.shown}"


def table(found):
    """rich Table of the levels."""
    event, plan = found.problem.event, found.problem.plan
    of_body = f" of {found.problem.body}" if found.problem.body else ""
    title = f"{plan.name}, seed {plan.seed}: {words(event)}{of_body}"
    heads = ("level", "beyond", ">probability", ">accepted", ">other seed accepted", ">flights")
    rows = [
        [
            str(k),
            words(event, event.sign * level.threshold),
            f"{level.probability:.3g}",
            _percent(level.accepted),
            _percent(level.redrawn_accepted),
            str(level.evaluated),
        ]
        for k, level in enumerate(found.estimate.levels)
    ]
    return columns.table(title, heads, rows, no_wrap=True)


def _percent(share):
    return "-" if share is None else f"{100.0 * share:.0f} %"


def lines(found):
    """What came out, in sentences."""
    estimate, event = found.estimate, found.problem.event
    low, high = estimate.interval
    about = f"95 %: {low:.2g} to {high:.2g}, coefficient of variation {100.0 * estimate.variation:.0f} %"
    if estimate.reached:
        yield f"probability of {words(event)}: {estimate.probability:.2g} ({about})"
    else:
        nearest = words(event, event.sign * estimate.levels[-1].threshold)
        likely = f"{estimate.probability:.2g} ({about})"
        yield f"{words(event)} is rarer than {nearest}, where --smallest ends the search: {likely}"
    if math.isfinite(estimate.plain):
        plain = f"{estimate.plain:.2g}" if estimate.plain >= 1e5 else f"{estimate.plain:.0f}"
        yield f"{estimate.evaluated} flights; plain Monte Carlo needs {plain} for the same coefficient"
    yield from _cautions(found)
    common = [f"{name} {mean:+.1f}" for name, mean, _ in in_common(found)[:MOST_COMMON] if abs(mean) > COMMON]
    if common:
        yield f"mean draws of the flights beyond it, in standard deviations: {', '.join(common)}"


def _cautions(found):
    estimate = found.estimate
    if len(estimate.levels) > 1 and estimate.levels[0].evaluated < FEW:
        yield (
            f"caution: {estimate.levels[0].evaluated} flights a level are few: of such intervals fewer than "
            f"95 % hold the truth, and the estimate is too large on the average; --runs {FEW} or more"
        )
    for level in estimate.levels:
        if level.accepted is not None and level.accepted < NO_BETTER:
            yield (
                f"caution: {_percent(level.accepted)} of the steps of a level are accepted; its chains "
                "hardly move, and the probability may be farther off than said"
            )
            break
    others = [one.redrawn_accepted for one in estimate.levels if one.redrawn_accepted is not None]
    if others and min(others) < NO_BETTER:
        yield (
            f"caution: another seed is accepted in {_percent(min(others))} of the steps; among seeds the "
            "search is no better than plain Monte Carlo"
        )
    if found.failed:
        first, beyond = estimate.levels[0].evaluated, found.estimate.samples
        if found.problem.of_failed == LEFT_OUT:
            yield (
                f"{found.failed} of the first {first} flights failed; they count as flights without the "
                "event, as was asked: the probability is, of all flights, that one does not fail and is "
                "beyond the limit"
            )
        else:
            here = sum(one.value == FAILED for one in beyond)
            yield (
                f"{found.failed} of the first {first} flights failed, and {here} of the {len(beyond)} beyond "
                "the last threshold; they count as the event, with --without-failed as flights without it"
            )


def worst(found):
    """rich Table of the worst flights and what each has drawn that is farthest from its mean."""
    event = found.problem.event
    measures = {one.name: one.measure for one in found.dispersed if is_of_flight(one)}
    of, rows = QUANTITIES[event.name], []
    for one in found.worst:
        largest = sorted(measures, key=lambda name: -abs(one.deviations[name]))[:MOST_DRAWS]
        drawn = (
            f"{name} {_written(one.draws[name], measures[name])} ({one.deviations[name]:+.1f} sigma)"
            for name in largest
        )
        figure = one.reason if one.value is None else f"{one.value * of.factor:.6g} {of.shown}"
        rows.append([figure, str(one.seed), "\n".join(drawn)])
    return columns.table("the worst of them", (event.name, ">--seed", "drawn"), rows)


def _written(value, measure):
    text = f"{value:.3g}" if isinstance(value, float) else str(value)
    return f"{text} {measure}".strip()


def summary(found):
    """Plain values, for JSON: SI."""
    problem, estimate = found.problem, found.estimate
    event = problem.event
    place = problem.place and dict(
        zip(("latitude_deg", "longitude_deg"), map(math.degrees, problem.place), strict=True)
    )
    return {
        "scenario": problem.plan.name, "seed": problem.plan.seed,
        "event": {
            "quantity": event.name, "is": "above" if event.sign > 0 else "below", "limit": event.limit,
            "unit": QUANTITIES[event.name].unit, "body": problem.body, "place": place,
        },
        "nominal": found.nominal,
        "reached": estimate.reached,
        "probability": estimate.probability if estimate.reached else None,
        "rarer_than": None if estimate.reached else estimate.interval[1],  # what is likely, not the estimate
        "coefficient_of_variation": estimate.variation,
        "interval_95": list(estimate.interval),
        "cautions": list(_cautions(found)),
        "flights": estimate.evaluated,
        "plain_monte_carlo_flights": estimate.plain if math.isfinite(estimate.plain) else None,
        "failed_of_first": found.failed,
        "failed_left_out": problem.of_failed == LEFT_OUT,
        "levels": [_level(event, level) for level in estimate.levels],
        "in_common": [
            {"path": name, "mean_sigma": mean, "standard_deviation_sigma": deviation}
            for name, mean, deviation in in_common(found)
        ],
        "worst": [
            {
                "value": one.value, "reason": one.reason, "seed": one.seed, "draws": writable(one.draws),
                "sigma": one.deviations,
            }
            for one in found.worst
        ],
    }  # fmt: skip


def _level(event, level):
    return {
        "threshold": event.sign * level.threshold, "share": level.share, "probability": level.probability,
        "coefficient_of_variation": level.variation, "accepted": level.accepted,
        "other_seed_accepted": level.redrawn_accepted, "flights": level.evaluated,
    }  # fmt: skip
