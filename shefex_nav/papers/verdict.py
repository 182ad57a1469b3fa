"""Whether a measured figure agrees with what was published or wanted, or whether the sample cannot tell."""

from math import inf, isfinite

POINTS = 0.10  # of a share: what counts as the same, and the interval that is narrow enough to say so
TOO_FEW = (
    "too few samples: the interval holds values that agree and values that do not, and is wider than the "
    "tolerance; a larger --samples narrows it"
)
NO_FIGURE = "these samples give no figure: what is asked for did not occur among them"


def judgement(measured, ci95, why, *, least=-inf, most=inf, resolves, refuted=False):
    """Judge one figure.

    A sample judges where its interval lies on one side of the criterion, or where the interval reaches no
    further than the tolerance of the criterion to either side. In the latter case the figure itself decides,
    as that of a paper does, which is a sample too. Otherwise the verdict is left open.

    Parameters
    ----------
    measured : float
    ci95 : (low, high), or None where there were too few values for one
    why : str, the reason if it disagrees
    least, most : float, the range that agrees
    resolves : float, greatest half width of an interval across a criterion that still judges
    refuted : bool, disagree only where the whole interval lies outside of the range

    Returns
    -------
    agrees : bool, or None where the sample cannot tell
    why : str, empty where it agrees
    """
    if not isfinite(measured):
        return None, NO_FIGURE
    low, high = (-inf, inf) if ci95 is None else ci95
    low, high = low if isfinite(low) else -inf, high if isfinite(high) else inf
    touches, leaves = high >= least and low <= most, low < least or high > most
    if touches and leaves and 0.5 * (high - low) > resolves:
        return None, TOO_FEW
    agrees = bool(touches if refuted else least <= measured <= most)
    return agrees, "" if agrees else why


def is_open(row):
    """Whether a Row was to be judged and its sample could not tell."""
    return row.agrees is None and row.why in (TOO_FEW, NO_FIGURE)
