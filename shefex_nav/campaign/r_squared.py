"""R^2 of a regression on draws: what the draws explain of all that there could be, not of these runs alone.

The fit to n runs explains more than the draws do, by about m/n of the rest with m features: with 40 of them
and 210 runs a true R^2 of 0.08 looks like 0.26. So the estimate is the adjusted R^2 (Ezekiel 1930), not below
0, and its interval is one of the true R^2: all of those under which that of the fit is no unlikely one.

The distribution of the latter for normal draws and noise (Fisher 1928) is a mixture of beta distributions
with negative binomial weights (Gurland 1968, J. R. Stat. Soc. B 30, 276). Draws and noise with heavy tails,
or noise whose size depends on a draw, spread it further: by the ratio c of the standard deviations of
log(R^2 / (1 - R^2)), from the fourth moments of fit and residuals. The interval is then that of c times as
many sigmas, never of fewer than for normal draws.
"""

import numpy as np

POINTS = 300  # of the mixture; more do not change four digits
ALL = 1e-9  # what is not explained, below which everything is


def estimate(fit, residuals, m, confidence):
    """R^2 of a regression with constant: value, low, high.

    fit, residuals : (n,), of mean zero
    m : int, independent features, 1 <= m < n - 1
    """
    from scipy import optimize, special

    n = len(fit)
    explained, left = float(fit @ fit), float(residuals @ residuals)
    r2 = explained / (explained + left)
    if 1.0 - r2 < ALL:
        return 1.0, 1.0, 1.0
    value = max(1.0 - (1.0 - r2) * (n - 1.0) / (n - 1.0 - m), 0.0)
    sigmas = special.ndtri(0.5 + 0.5 * confidence)
    moments = _moments(fit, residuals, m)

    def end(sign):
        def beyond(log):  # of 1 / (1 - true R^2): falls as it grows
            ratio = np.expm1(log)
            wider = _spread(ratio, n, m, moments) / _spread(ratio, n, m, (0.0, 0.0, 1.0))
            return _below(r2, ratio, n, m) - special.ndtr(sign * sigmas * max(np.sqrt(max(wider, 0.0)), 1.0))

        if beyond(0.0) <= 0.0:
            return 0.0
        high = -np.log1p(-r2) + 1.0
        while beyond(high) > 0.0:
            high += 1.0
        return float(-np.expm1(-optimize.brentq(beyond, 0.0, high, xtol=1e-7)))

    return value, end(1.0), end(-1.0)


def _below(r2, ratio, n, m):
    """Probability of an R^2 of the fit below r2. ratio : true explained variance over the rest"""
    from scipy import special

    b = 0.5 * (n - 1.0 - m)
    if ratio <= 0.0:
        return float(special.betainc(0.5 * m, b, r2))
    s = 0.5 * (n - 1.0)
    mean, sigma = s * ratio, np.sqrt(s * ratio * (1.0 + ratio))
    first, last = max(np.floor(mean - 10.0 * sigma), 0.0), np.ceil(mean + 12.0 * sigma) + 10.0
    k = np.arange(first, last + 1.0, max(np.ceil((last - first) / POINTS), 1.0))
    weight = special.gammaln(s + k) - special.gammaln(k + 1.0) + k * np.log(ratio / (1.0 + ratio))
    weight = np.exp(weight - weight.max())
    return float(weight @ special.betainc(0.5 * m + k, b, r2) / weight.sum())


def _moments(fit, residuals, m):
    """Excess kurtosis of fit and of noise; mean product of their squares, 1 if they are independent."""
    from scipy import stats

    n = len(fit)
    of_fit = float(stats.kurtosis(fit, bias=False)) if fit.any() else 0.0
    # a residual is (1 - m/n) of its own noise and a little of all others', which hides its tails
    of_noise = float(stats.kurtosis(residuals, bias=False)) / (1.0 - (m + 1.0) / n) ** 2
    both = np.mean(fit**2) * np.mean(residuals**2)
    return (
        max(of_fit, -2.0),
        max(of_noise, -2.0),
        float(np.mean(fit**2 * residuals**2) / both) if both else 1.0,
    )


def _spread(ratio, n, m, moments):
    """Variance of the log of explained over unexplained variance of a fit."""
    of_fit, of_noise, together = moments
    left = n - 1.0 - m
    mean = (n - 1.0) * ratio + m
    explained = 2.0 * m + (4.0 * ratio * together + (2.0 + of_fit) * ratio**2) * (n - 1.0)
    return explained / mean**2 + 2.0 / left + of_noise / n - 2.0 * (together - 1.0) * ratio / mean
