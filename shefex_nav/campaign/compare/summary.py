"""A comparison for programs: the object that `shefex-nav compare --json` prints."""

import math

from shefex_nav.campaign.compare import described, paired, parts
from shefex_nav.scenario import differences
from shefex_nav.scenario.document import dotted

VERDICTS = {
    paired.A_BETTER: "a",
    paired.B_BETTER: "b",
    paired.NOT_SEEN: "none",
    paired.EQUAL: "none",
    paired.NOT_JUDGED: None,
    paired.OPEN: None,
    None: None,
}


def summary(sides, found):
    """Plain dict of the sides and of the Comparisons with the first of them, ready for JSON."""
    return {
        "confidence": paired.CONFIDENCE,
        "sides": [side.result() for side in sides],
        "comparisons": [_comparison(one) for one in found],
        "covariances": {side.letter: [one.result() for one in described.of_side(side)] for side in sides},
        "reports": parts.reports(sides),
    }


def _comparison(one):
    return {
        "a": one.a.letter,
        "b": one.b.letter,
        "pairs": len(one.seeds),
        "seeds": list(one.seeds),
        "figures": [_row(row) for row in one.rows],
        "shares": [_happened(row) for row in one.shares],
        "scenario_differences": [
            {"path": dotted(path), "a": _given(a), "b": _given(b)} for path, a, b in one.different
        ],
        "notes": list(one.notes),
        "commands": parts.commands(one),
    }


def _given(value):
    return None if value is differences.NOT_GIVEN else value


def _row(row):
    return {
        "name": row.quantity.name,
        "unit": row.quantity.unit,
        "better": row.quantity.better,
        "a": None if row.a is None else row.a._asdict(),
        "b": None if row.b is None else row.b._asdict(),
        "difference": _difference(row.difference),
        "each": [value if math.isfinite(value) else None for value in row.each.tolist()],
        "why": row.why,
    }


def _happened(row):
    return {
        "name": row.name,
        "a": row.a._asdict(),
        "b": row.b._asdict(),
        "difference": _difference(row.difference),
        "why": row.why,
    }


def _difference(found):
    if found is None:
        return None
    plain = {key: value for key, value in found._asdict().items() if key != "why"}
    mean = found.mean if math.isfinite(found.mean) else None
    return plain | {"mean": mean, "verdict": VERDICTS[found.verdict]}
