"""A trade as tables for people and as an object for other programs."""

import math
import shlex
import string

from shefex_nav.report import columns
from shefex_nav.report.requirements import words
from shefex_nav.verify.trade import judge
from shefex_nav.verify.trade.predict import END, ENTRY, POINTING, STARS

CHEAPEST = "cheapest that meets all that is predicted"
CORNERS = 4  # settings, of which a campaign flies first and last: 16 combinations
TITLES = {
    STARS: "Largest predicted errors between star fixes",
    POINTING: "Largest predicted errors while pointing",
    ENTRY: "Predicted errors at entry",
    END: "Predicted errors at end",
}
UNITS = (("attitude", "attitude_b", "deg", math.degrees(1.0)), ("position", "position_i", "m", 1.0),
         ("velocity", "velocity_i", "m/s", 1.0))  # fmt: skip


def sigma(errors, field):
    """1 sigma of a whole error (Errors, name of a field), SI."""
    return math.sqrt(getattr(errors, field).trace())


def as_numbers(study, asked):
    """Plain dict for JSON. plan.Study, plan.Asked"""
    return {
        "scenario": study.name,
        "seed": asked.seed,
        "probability": study.probability,
        "not_predicted": list(study.unpredicted),
        "without_effect": list(study.idle),
        "combinations": [_combination(one, one is study.cheapest) for one in study.combinations],
    }


def _combination(one, is_cheapest):
    found = {"settings": one.settings, "met": one.met, "cost": one.cost, "cheapest": is_cheapest}
    if one.prediction is None:
        return found | {"refused": one.refused}
    prediction = one.prediction
    return found | {
        "errors": {
            what: _errors(prediction.at(what)) for what in TITLES if prediction.at(what) is not None
        },
        "requirements": [
            {**each._asdict(), "k": each.k, "met": each.met} for each in one.judged
        ],
        "gps_fixes": prediction.gps_fixes,
        "star_frames": prediction.star_frames,
        "star_fixes": prediction.star_fixes,
        "star_sigma_arcsec": _arcsec(prediction.star_sigma),
        "second_star_fix_s": prediction.second_star_s,
        "warnings": list(prediction.warnings),
        "doubtful": prediction.doubtful,
        "statistics_of_other_settings": list(prediction.taken_over),
    }  # fmt: skip


def _errors(errors):
    """1 sigma: of each axis of the attitude, and of the whole of each."""
    axes = [math.degrees(math.sqrt(value)) for value in errors.attitude_b.diagonal()]
    whole = {
        f"{name}_{unit.replace('/', '_')}": factor * sigma(errors, field)
        for name, field, unit, factor in UNITS
    }
    return {"t_s": errors.t_s, "attitude_axes_deg": axes, **whole}


def _arcsec(angle):
    return None if math.isnan(angle) else math.degrees(angle) * 3600.0


def tables(study, asked):
    """(list of rich Tables, lines of text below them). plan.Study, plan.Asked"""
    notes = _Notes()
    required = next((one.judged for one in study.combinations if one.judged), ())
    found = [_verdicts(study, asked, required, notes)]
    predicted = [one.prediction for one in study.combinations if one.prediction]
    found += [_sizes(study, what) for what in TITLES if any(one.at(what) for one in predicted)]
    return found, [*_lines(study, asked, required), *notes.lines()]


def _verdicts(study, asked, required, notes):
    """Table of what is required."""
    rows = []
    for rank, one in enumerate(study.combinations, 1):
        cost = [] if one.cost is None else [f"{'* ' if one is study.cheapest else ''}{one.cost:g}"]
        cells = [_verdict(each, one.prediction.doubtful) for each in one.judged] or ["-"] * len(required)
        cells += _stars(one.prediction)
        rows.append((str(rank), *one.settings.values(), *cost, *cells, notes.of(one)))
    limits = [
        f">{one.name.replace('_', ' ')} [{one.unit}], {words(one.name, one.limit, '')}" for one in required
    ]
    heads = ("", *study.combinations[0].settings, *([">cost"] if asked.costs else []), *limits,
             ">frames with a fix", ">noise of a fix [arcsec]", "notes")  # fmt: skip
    share = f"{100.0 * study.probability:.6g} %"
    title = "what the star tracker sees"
    if required:
        title = f"{share} of flights are predicted to be within"
    return columns.table(f"{study.name}: {title}", heads, rows)


def _verdict(one, doubtful):
    """A Judged in a cell."""
    verdict = ("met" if one.met else "NOT met") + "?" * doubtful
    if one.found is None:
        return f"{'no entry' if one.name.endswith('at_entry') else 'never points'}, {verdict}"
    return f"{one.found:.3g} {verdict}"


def _stars(prediction):
    """Share of the frames with a star fix, and the size of one [arcsec], as cells."""
    if prediction is None or not prediction.star_frames:
        return ["-", "-"]
    arcsec = _arcsec(prediction.star_sigma)
    share = f"{100.0 * prediction.star_fixes / prediction.star_frames:.0f} %"
    return [share, "-" if arcsec is None else f"{arcsec:.2g}"]


def _sizes(study, what):
    """Table of the errors at one of TITLES."""
    rows = []
    for rank, one in enumerate(study.combinations, 1):
        errors = one.prediction and one.prediction.at(what)
        cells = ["-"] * 7 if errors is None else [*_errors_of(errors), f"{errors.t_s:+.1f}"]
        rows.append((str(rank), *one.settings.values(), *cells))
    attitude = (">attitude [deg]", ">about x", ">about y", ">about z")
    others = (">position [m]", ">velocity [m/s]", ">attitude at T [s]")
    heads = ("", *study.combinations[0].settings, *attitude, *others)
    return columns.table(f"{TITLES[what]}, 1 sigma", heads, rows)


def _errors_of(errors):
    """Attitude, its three axes, position, velocity, as cells."""
    axes = [f"{math.degrees(math.sqrt(value)):.3g}" for value in errors.attitude_b.diagonal()]
    whole, *others = (f"{factor * sigma(errors, field):.3g}" for _, field, _, factor in UNITS)
    return [whole, *axes, *others]


class _Notes:
    """Texts about some combinations, each under a letter."""

    def __init__(self):
        self._letters = {}

    def of(self, one):
        """Letters of what there is to say of a Combination."""
        if one.prediction is None:
            texts = [f"no prediction: {one.refused}"]
        else:
            texts = [f"check warns: {text}" for text in one.prediction.warnings]
            texts += _before_stars(one)
            if one.prediction.taken_over:
                texts.append(
                    "the star tracker's statistics were fitted to other settings, its shares of stars found "
                    f"and of frames identified are taken over: {', '.join(one.prediction.taken_over)}"
                )
        return " ".join(self._letters.setdefault(text, _letter(len(self._letters))) for text in texts)

    def lines(self):
        """One line for each letter."""
        return [f"{letter}: {text}" for text, letter in self._letters.items()]


def _before_stars(one):
    """Texts about required attitudes whose worst instant is before the second star fix. Combination"""
    return [
        f"{each.name.replace('_', ' ')}: at T{one.prediction.at(what).t_s:+.1f} s, before the second star "
        "fix; it says nothing of the attitude that stars give"
        for each in one.judged
        for what, quantity in (judge.PREDICTED[each.name],)
        if quantity == "attitude" and one.prediction.before_stars(what)
    ]


def _letter(k):
    letters = string.ascii_lowercase
    return letters[k] if k < len(letters) else letters[k // len(letters) - 1] + letters[k % len(letters)]


def _lines(study, asked, required):
    """What the table means, and where it cannot be trusted."""
    found = []
    if required:
        for k, one in enumerate(required):
            ks = sorted(each.judged[k].k for each in study.combinations if each.judged and each.judged[k].k)
            if ks:
                whole = "of the largest angle about an axis" if one.unit == "deg" else "of the whole vector"
                found.append(
                    f"{one.name.replace('_', ' ')}: {ks[0]:.2f} to {ks[-1]:.2f} sigma {whole} hold "
                    f"{100.0 * study.probability:.6g} % of Gaussian errors (requirements.probability)."
                )
        found.append("Ranked by the largest share of a limit that is used up.")
    else:
        found.append("Nothing is required that a covariance could say. Ranked by the attitude at the end.")
    if study.unpredicted:
        found.append(f"Required, but not predicted: {', '.join(study.unpredicted)}.")
    if study.idle:
        found.append(f"Without any effect on the linear model: {', '.join(study.idle)}.")
    if asked.costs:
        best = study.cheapest
        if not required:
            found.append("So no cheapest is marked.")
        elif best is None:
            found.append("None meets all requirements without doubt.")
        else:
            settings = ", ".join(f"{key} {value}" for key, value in best.settings.items())
            found.append(f"* {CHEAPEST}: {settings}, {best.cost:g}.")
    return [*found, *CAUTION, f"Monte Carlo of the corner points: {corners(asked, study.cheapest)}"]


CAUTION = (
    "This is what the best filter could do with these measurements, along one flight and with one draw of "
    "GPS outages. Flown errors of the default mission are 0.8 to 1.4 times the predicted ones.",
    "met? and NOT met?: before that time the IMU comes to the end of its range, or the attitude is known to "
    "5 deg or less well: the linear model does not hold, and the filter may be lost.",
    "Not in it: wrong identification of stars, sensors at the end of their range, faults, dispersed flights, "
    "and settings of the software.",
)


def corners(asked, cheapest=None):
    """Command that flies first and last value of four settings, the first of others, and the cheapest's own.

    plan.Asked;  cheapest : the Combination that is marked, or None
    """
    words = ["shefex-nav", "campaign", asked.scenario, "--runs", "100", "--seed", str(asked.seed)]
    for k, one in enumerate(asked.axes):
        marked = {cheapest.settings[one.key]} if cheapest else set()
        flown = {one.values[0], *([one.values[-1]] if k < CORNERS else []), *marked}
        text = f"{one.key}={','.join(value for value in one.values if value in flown)}"
        words += ["--sweep" if k < CORNERS or len(flown) > 1 else "--set", text]
    return shlex.join([*words, *(word for text in asked.overrides for word in ("--set", text))])
