"""Tables 6 to 13 of the IMPA paper beside what the campaign gives, and our tracker's share of it.

Success: both cross-boresight angles within 360 arcsec. Wrong: an attitude that was given out with one of them
beyond that, or with the error about the boresight beyond 0.5 deg.
"""

import numpy as np

from shefex_nav.papers import rows
from shefex_nav.papers.impa.field import N_ATTITUDES, PAIRS_OF_ALL, SHUTTERS
from shefex_nav.papers.impa.flight import CASES, SITUATIONS
from shefex_nav.papers.impa.published import ATTITUDE_MEAN_ARCSEC, IMPA
from shefex_nav.papers.impa.trackers import ACCEPTANCES
from shefex_nav.papers.verdict import POINTS
from shefex_nav.report import intervals

IMAGES = tuple(IMPA["success_percent_by_images"][CASES[0]][SHUTTERS[0]])
RATES = (0.0, *(float(rate) for rate in IMPA["protocol"]["rates_deg_s"]))
FAST = 10.0
AXES = ("pitch", "yaw", "roll")  # the paper's names of our x, y, z
SUCCESS_ARCSEC = float(IMPA["protocol"]["success_arcsec"])
ROLL_ARCSEC = 0.5 * 3600.0
COVERED = 1.1  # RMS of the errors over their sigmas that still counts as covered
STD_MARGIN = 0.25  # of a standard deviation: known so well, two can be said to be the same
OWN_GOALS = {"best_case": 0.98, "worst_case": 0.95}  # of ours at 5 deg/s within two images

WITHIN_TWO_SIGMA, NORMAL = 0.9545, 0.03  # of a normal distribution; what counts as such

PITCH = (
    "the paper's mean grows with the rate; impa-joint/both ends has it: extents that are too long, where a "
    "flight ends with a star that has just come in. Of two images alone (impa-pitch) there is none"
)
BOTH_ENDS = len(ACCEPTANCES)  # of the attitudes of the joint set: extents that count both ends
BY_BOTH_ENDS = (
    "2 things otherwise: extents (7) count both end rows and columns, and errors are truth less estimate, "
    "of which the paper says nothing"
)

N_AT_RATE, N_AT_REST = PAIRS_OF_ALL, N_ATTITUDES  # simulations of the paper in each cell


def stack(results):
    """Results of the chunks as one dict of arrays."""
    return {name: np.concatenate([result[name] for result in results]) for name in results[0]}


def good(error_arcsec):
    """Whether errors are within 360 arcsec across the boresight. (..., 3) -> (...) bool, False for NaN."""
    return (np.abs(error_arcsec[..., :2]) <= SUCCESS_ARCSEC).all(axis=-1)


def wrong(given, error_arcsec):
    """Attitudes that were given out and are wrong: across the boresight, about it. (...) bool each."""
    return given & ~good(error_arcsec), given & ~(np.abs(error_arcsec[..., 2]) <= ROLL_ARCSEC)


def conclude_images(results):
    """Tables 8, 9, 12, 13; the wrong ones; the same of ours."""
    found = stack(results)
    return image_rows(found) + published_wrong_rows(found) + _own_wrong_rows(found) + own_rows(found)


def conclude_joint(results):
    """All tables with the joint set of assumptions; table 8 is what it was fitted to."""
    found, out = stack(results), []
    for row in image_rows(found):
        is_fitted = row.condition.startswith("best case, global shutter")
        out.append(rows.calibrated(row) if is_fitted else row)
    out += published_wrong_rows(found)
    for case, shutter, r, here in _cells(found):
        condition = _condition(case, shutter, RATES[r])
        mine = _moment_rows("IMPA", condition, _right(here), case, shutter, r)
        is_moved = shutter == "rolling_shutter"  # by the compensation
        out += _explained_by_both_ends(mine, found, (case, shutter, r)) if is_moved else mine
    return out


def _explained_by_both_ends(mine, found, cell):
    """Rows of the attitude errors of a cell, explained by longer extents where these reach.

    Of the means that of pitch alone: longer extents make none of roll and yaw, what differs there is chance.
    """
    case, shutter, r = cell
    errors = -right_errors(found, case, shutter, RATES[r], BOTH_ENDS)
    others = {one.quantity: one for one in _moment_rows("IMPA", "", errors, *cell)}
    others = {name: one for name, one in others.items() if "std" in name or "mean of pitch" in name}
    how = "impa-joint/both ends", BY_BOTH_ENDS
    return [
        rows.explained(one, others[one.quantity], *how) if one.quantity in others else one for one in mine
    ]


def _condition(case, shutter, rate):
    return f"{_words(case)}, {_words(shutter)}, {rate:g} deg/s"


def _cells(found):
    """(case, shutter, number of the rate, (n, 4) with verified acceptance) of what was flown: iterator."""
    for c, case in enumerate(CASES):
        for s, shutter in enumerate(SHUTTERS):
            for r, rate in enumerate(RATES):
                here = found["published"][found["rate_deg_s"] == rate][:, s, c, 0]
                if len(here):
                    yield case, shutter, r, here


def _right(codes_and_errors):
    """Errors of the right attitudes. (n, 4) -> (m, 3) arcsec."""
    codes, errors = codes_and_errors[:, 0], codes_and_errors[:, 1:]
    return errors[(codes > 0) & good(errors)]


def right_errors(found, case, shutter, rate, attitude=0):
    """Errors of the right attitudes of the paper's chain at a rate [deg/s]: (m, 3) arcsec, as AXES."""
    here = found["published"][found["rate_deg_s"] == rate][:, SHUTTERS.index(shutter), CASES.index(case)]
    return _right(here[:, attitude])


def image_rows(found):
    """Every cell of tables 8, 9, 12 and 13."""
    return [
        _images_row(here, images, _condition(case, shutter, RATES[r]), (case, shutter, r))
        for case, shutter, r, here in _cells(found)
        for images in IMAGES
    ]


def _images_row(published, images, condition, cell):
    """One cell of the tables."""
    case, shutter, r = cell
    share = IMPA["success_percent_by_images"][case][shutter][images][r] / 100.0
    done = (published[:, 0] > 0) & (published[:, 0] <= images) & good(published[:, 1:])
    given = f"IMPA: success within {images} images", condition, share, done.sum(), len(done)
    n_published = N_AT_RATE if RATES[r] else N_AT_REST
    return rows.published_share(*given, n_published=n_published, rounding=5e-5, better="more")


def published_wrong_rows(found):
    """Wrong attitudes of the paper's chain, which the text says there were none of (section 6.2)."""
    out = []
    for s, shutter in enumerate(SHUTTERS):
        frames = int(found["flown"][:, s].sum())
        for c, case in enumerate(CASES):
            condition = f"{_words(case)}, {_words(shutter)}, {frames} frames flown"
            here = [found["published"][:, s, c, a] for a in range(len(ACCEPTANCES))]
            flags = [(one[:, 0] > 0, *wrong(one[:, 0] > 0, one[:, 1:])) for one in here]
            counts = [[int(flag.sum()) for flag in those] for those in flags]  # given out, wrong ones
            each = (f"{name} {k} of {n}" for name, (n, k, _) in zip(ACCEPTANCES, counts, strict=True))
            why = "wrong of what was given out: " + ", ".join(each)
            for acceptance, (n, across, about) in zip(ACCEPTANCES, counts, strict=True):
                given = f"IMPA {acceptance}: wrong across the boresight", condition
                if n:
                    of_paper = {"n_published": len(RATES[1:]) * N_AT_RATE + N_AT_REST, "why": why}
                    out.append(rows.published_share(*given, 0.0, across, n, **of_paper))
                    quantity = f"IMPA {acceptance}: wrong about the boresight"
                    out.append(rows.share(quantity, condition, about, n))
    return out


def _own_wrong_rows(found):
    """Wrong attitudes of ours, of all frames flown."""
    out = []
    for s, shutter in enumerate(SHUTTERS):
        for k, situation in enumerate(SITUATIONS):
            own = found["own"][:, s, k]  # (simulations, frames, 7)
            across, about = wrong(own[..., 0] > 0, own[..., 1:4])
            condition = f"{_words(situation)}, {_words(shutter)}, {across.size} frames"
            for what, which in (("across", across), ("about", about)):
                quantity = f"ours: wrong {what} the boresight [attitudes]; goal: none"
                out.append(rows.goal_none(quantity, condition, which))
    return out


def own_rows(found):
    """Ours: success within two images, beside the paper's own for two."""
    out = []
    for s, shutter in enumerate(SHUTTERS):
        for k, situation in enumerate(SITUATIONS):
            for r, rate in enumerate((*RATES, FAST)):
                own = found["own"][found["rate_deg_s"] == rate][:, s, k]
                if not len(own):
                    continue
                done = (good(own[..., 1:4]) & (own[..., 0] > 0)).any(axis=1)
                given, quantity = (int(done.sum()), len(done)), "ours: success within 2 images"
                condition = f"{_words(situation)}, {_words(shutter)}, {rate:g} deg/s"
                if situation not in CASES or rate == FAST:
                    out.append(rows.share(quantity, condition, *given))
                    continue
                share = IMPA["success_percent_by_images"][situation][shutter][2][r] / 100.0
                if rate == RATES[-1]:
                    goal, n = OWN_GOALS[situation], len(done)
                    measured = share, done.mean(), rows.intervals.proportion(int(done.sum()), n), n
                    quantity += f"; goal: at least {100.0 * goal:g} %"
                    out.append(rows.goal(quantity, condition, *measured, least=goal, resolves=POINTS))
                else:
                    how = {"n_published": N_AT_RATE if rate else N_AT_REST, "better": "more"}
                    out.append(rows.published_share(quantity, condition, share, *given, **how))
    return out


def conclude_attitude(results):
    """Tables 6, 7, 10, 11: means and standard deviations of the right attitudes, and of ours."""
    found = stack(results)
    out = []
    for case, shutter, r, here in _cells(found):
        condition = _condition(case, shutter, RATES[r])
        out += _moment_rows("IMPA", condition, _right(here), case, shutter, r)
        at = found["rate_deg_s"] == RATES[r]
        if case == CASES[0] and RATES[r] == RATES[-1]:
            out += _normal_rows(condition, _right(here))
        own = found["own"][at][:, SHUTTERS.index(shutter), CASES.index(case)].reshape(-1, 7)
        is_good = (own[:, 0] > 0) & good(own[:, 1:4])
        out += _sigma_rows(condition, own[is_good, 1:4] / own[is_good, 4:7])
        out += _moment_rows("ours", condition, own[is_good, 1:4], case, shutter, r)
    return out


def _normal_rows(condition, errors):
    """Figure 15: 'well-fitted by Gaussian curves', so 95.4 % lie within two sigma. (n, 3) arcsec"""
    out, n = [], len(errors)
    for axis in range(3 if n > 1 else 0):
        off = np.abs(errors[:, axis] - errors[:, axis].mean())
        k = int((off <= 2.0 * errors[:, axis].std(ddof=1)).sum())
        given = f"IMPA: {AXES[axis]} within two sigma; published: as of a normal", condition, WITHIN_TWO_SIGMA
        measured = k / n, intervals.proportion(k, n), n
        criterion = {"least": WITHIN_TWO_SIGMA - NORMAL, "most": WITHIN_TWO_SIGMA + NORMAL}
        out.append(
            rows.statement(*given, *measured, "the errors have other tails", **criterion, resolves=NORMAL)
        )
    return out


def _sigma_rows(condition, normal):
    """Whether the covariances of our attitudes cover their errors, axis by axis. (n, 3)"""
    out, criterion = [], {"most": COVERED, "resolves": STD_MARGIN * COVERED, "refuted": True}
    for axis in range(3 if len(normal) > 1 else 0):
        ratio, interval = float(np.sqrt((normal[:, axis] ** 2).mean())), intervals.rms(normal[:, axis])
        quantity = f"ours: {AXES[axis]} error over its sigma, RMS; goal: {COVERED:g} is possible"
        out.append(rows.goal(quantity, condition, None, ratio, interval, len(normal), **criterion))
    return out


def _moment_rows(name, condition, errors, case, shutter, r):
    """Standard deviation and mean about the three axes. (n, 3) arcsec"""
    out, n = [], len(errors)
    simulations = N_AT_RATE if RATES[r] else N_AT_REST
    flown = IMPA["success_percent_by_images"][case][shutter][max(IMAGES)][r] / 100.0 * simulations
    for axis in range(3 if n > 1 else 0):
        own, words = errors[:, axis], AXES[axis]
        value = IMPA["attitude_error_std_arcsec"][case][shutter][words][r]
        std, interval = float(own.std(ddof=1)), intervals.rms(own - own.mean())
        half = 1.96 / np.sqrt(2.0 * flown)  # of the paper's, if its errors are normal, as it says
        how = {"rounding": 0.005, "of_paper": (value * (1.0 - half), value * (1.0 + half)), "better": "less"}
        given = value, std, interval, n
        if name == "ours" and RATES[r] == RATES[-1]:
            quantity, criterion = f"{name}: std of {words} [arcsec]; goal: under half", {"most": 0.5 * value}
            out.append(rows.goal(quantity, condition, *given, **criterion, resolves=0.5 * STD_MARGIN * value))
        else:
            quantity = f"{name}: std of {words} [arcsec]"
            out.append(rows.figure(quantity, condition, *given, resolves=STD_MARGIN * value, **how))
        if name == "IMPA":
            mean, half = ATTITUDE_MEAN_ARCSEC[case][shutter][words][r], 1.96 * value / np.sqrt(flown)
            how = {"rounding": 0.005, "of_paper": (mean - half, mean + half), "resolves": STD_MARGIN * value}
            how["why"] = PITCH if (words, shutter) == ("pitch", "rolling_shutter") else ""
            given = mean, float(own.mean()), intervals.mean(own), n
            out.append(rows.figure(f"{name}: mean of {words} [arcsec]", condition, *given, **how))
    return out


def _words(name):
    return name.replace("_", " ")
