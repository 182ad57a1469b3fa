"""Errors of a run over time beside what its filter believes of them, as the pictures of a comparison need."""

from typing import NamedTuple

import numpy as np

from shefex_nav.campaign.compare.given import LOG
from shefex_nav.report.navigation_errors import navigation_errors

EVERY_S = 1.0  # of a log
ERRORS = {"position": "position_error_i", "velocity": "velocity_error_i", "attitude": "attitude_error_b"}
SIGMAS = {"position": "position_sigma_i", "velocity": "velocity_sigma_i", "attitude": "attitude_sigma_b"}


class Course(NamedTuple):
    """One run; {quantity: (N,)} in SI."""

    t_s: np.ndarray
    error: dict  # sizes
    sigma: dict  # root of the sum of the variances of the three axes; NaN where the software gives none


def courses(side, seeds):
    """Courses of those runs of a side that have them: list."""
    if side.kind == LOG:
        return [_of_data(side.data)]
    from shefex_nav.campaign import results

    campaign, found = results.open_campaign(side.where), []
    for seed in seeds:
        try:
            kept = campaign.series(side.runs[seed].run)
        except KeyError:  # of a failed run, or not kept
            continue
        found.append(
            _course(kept["t_s"], *({q: kept[name] for q, name in of.items()} for of in (ERRORS, SIGMAS)))
        )
    return found


def _course(t_s, errors, sigmas):
    """Course of errors and sigmas {quantity: (N, 3)}."""
    size = ({q: np.sqrt((one**2).sum(axis=1)) for q, one in of.items()} for of in (errors, sigmas))
    return Course(t_s, *size)


def _of_data(data):
    from shefex_nav.report.pairing import same_times

    errors, covariance = navigation_errors(data), data.covariance
    i, j = same_times(errors.t_s, covariance.t_s)
    sigma = np.sqrt(np.einsum("kii->ki", covariance.P[j]))
    if not len(i):  # software that gives no covariance at all
        i = np.arange(len(errors.t_s))
        sigma = np.full((len(i), 9), np.nan)
    step = max(round(EVERY_S / np.median(np.diff(errors.t_s[i]))), 1) if len(i) > 1 else 1
    i, sigma = i[::step], sigma[::step]
    found = (errors.position_i[i], errors.velocity_i[i], errors.attitude_b[i])
    return _course(
        errors.t_s[i],
        dict(zip(ERRORS, found, strict=True)),
        {q: sigma[:, 3 * k : 3 * k + 3] for k, q in enumerate(SIGMAS)},
    )
