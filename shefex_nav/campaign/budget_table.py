"""A budget of errors as tables for people, and for programs."""

from shefex_nav.campaign.budget import END, ENTRY, GRAVITY, QUANTITIES
from shefex_nav.campaign.parts import Bold, Part
from shefex_nav.report import sensor_use

LEAST = 1e-3  # share of a source that has a row of its own
FEW = 6
TITLES = {ENTRY: "At entry", END: "At the end"}
REST = "not explained"


def parts(found, scenario):
    """list of campaign.parts.Part. budget.Budget, Scenario of the whole flights"""
    made = [_instant(found, instant) for instant in found.whole]
    return [*made, Part("How to read it", lines=tuple(_lines(found, scenario)))]


def ranked(found, instant):
    """Names of the sources, the largest share of any quantity first: list of (name, {quantity: Given})."""

    def largest(one):
        return max((given.share for given in one[1].values() if given is not None), default=0.0)

    return sorted(((name, one[instant]) for name, one in found.sources.items()), key=largest, reverse=True)


def _instant(found, instant):
    rows, small = [], []
    for name, of_source in ranked(found, instant):
        if any(one is None or one.share >= LEAST for one in of_source.values()):
            rows.append((name.replace("_", " "), *_cells(of_source)))
        else:
            small.append(name.replace("_", " "))
    rows.append((Bold(REST), *_cells(found.rest[instant])))
    heads = ["error of the world"]
    for quantity, (_, unit, _) in QUANTITIES.items():
        heads += [f">{quantity} [{unit}]", ">share (95 %)", ">without"]
    whole = ", ".join(
        f"{quantity} {found.whole[instant][quantity]:.3g} {unit}"
        for quantity, (_, unit, _) in QUANTITIES.items()
    )
    lines = [f"The whole error, rms over {found.runs} runs: {whole}."]
    if small:
        lines.append(f"Less than {100.0 * LEAST:g} % of each: {', '.join(small)}.")
    return Part(TITLES[instant], tuple(heads), tuple(rows), tuple(lines))


def _cells(of_source):
    for one in of_source.values():
        if one is None:
            yield from ("-", "-", "-")
            continue
        bounds = "" if one.low is None else f" ({_percent(one.low)} to {_percent(one.high)})"
        yield from (f"{one.rms:.3g}", f"{_percent(one.share)} %{bounds}", f"{one.rms_without:.3g}")


def _percent(share):
    """A share in per cent, without more digits than mean anything."""
    value = 100.0 * share
    return f"{value:.0f}" if value >= 9.95 else f"{value:.1f}" if value >= 0.05 else "0"


def _lines(found, scenario):
    for sensor, share in found.refused.items():
        yield Bold(
            f"{sensor_use.named(sensor)}: the filter refused {_percent(share)} % of them. The shares mean "
            "little until it uses them."
        )
    yield (
        "Each row is flown without this error alone; the computer counts with it as before. "
        "First comes the rms of what the error does: the difference between the two flights of a seed. Then "
        "its share of the mean square of the whole, and the rms error of the flights without it."
    )
    yield (
        "Shares of errors that have nothing to do with each other add up to 100 % but for chance. "
        f"{REST.capitalize()}: what is left of each flight's error when all rows are taken away: errors that "
        "have no row (instruments, wrong values of navigation.told, integration), and what is not linear."
    )
    if GRAVITY in found.sources:
        yield (
            "Gravity: the world's field beyond J2, which the built-in filter does not have; without it the "
            "vehicle flies a little differently."
        )
    if found.runs < FEW:
        yield Bold(f"Of {found.runs} runs the intervals mean little: fly more.")
    yield from found.notes


def as_numbers(found, scenario, seed):
    """Plain dict for JSON."""
    return {
        "scenario": scenario.mission.name,
        "seed": seed,
        "runs": found.runs,
        "units": {quantity: unit for quantity, (_, unit, _) in QUANTITIES.items()},
        "whole_rms": found.whole,
        "sources": {
            name: {instant: _numbers(one[instant]) for instant in one} for name, one in found.sources.items()
        },
        "not_explained": {instant: _numbers(one) for instant, one in found.rest.items()},
        "notes": list(found.notes),
        "mostly_refused": found.refused,
    }


def _numbers(of_source):
    return {quantity: None if one is None else one._asdict() for quantity, one in of_source.items()}
