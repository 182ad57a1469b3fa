"""Probability laws of what is drawn, as plain numbers in the unit of the dispersion.

Each has `draw(u, run)`: its value where the distribution function is u, 0 < u < 1; and `reach()`: the values
within which practically all draws lie, by which a dispersion is checked before anything is flown.
"""

import math
from typing import Any, NamedTuple

FAR = 3.0  # sigma that a law without bounds is checked to
FARTHEST = 1e4  # sigma, from the mean to the part of a normal law that is left of it; beyond, digits end


class NormalLaw(NamedTuple):
    """Gaussian."""

    mean: float
    sigma: float

    def draw(self, u, run):
        """Value at the probability u."""
        from scipy.special import ndtri

        return self.mean + self.sigma * float(ndtri(u))

    def reach(self):
        """mean -+ 3 sigma."""
        return self.mean - FAR * self.sigma, self.mean + FAR * self.sigma


class TruncatedLaw(NamedTuple):
    """Gaussian between two bounds."""

    mean: float
    sigma: float
    low: float
    high: float

    def draw(self, u, run):
        """Value at the probability u."""
        from scipy.special import ndtr, ndtri

        a, b = (self.low - self.mean) / self.sigma, (self.high - self.mean) / self.sigma
        if a > 0.0:  # in a tail, where a probability may be too small for a number
            z = -_in_lower_tail(-a, -b, u)
        elif b < 0.0:
            z = _in_lower_tail(b, a, 1.0 - u)
        else:
            z = ndtri(ndtr(a) + u * (ndtr(b) - ndtr(a)))
        return min(max(self.mean + self.sigma * float(z), self.low), self.high)

    def reach(self):
        """The bounds, or 3 sigma where there is none."""
        low, high = NormalLaw(self.mean, self.sigma).reach()
        return (
            self.low if math.isfinite(self.low) else low,
            self.high if math.isfinite(self.high) else high,
        )


def _in_lower_tail(begin, end, share):
    """Standard normal deviate z, end < z < begin <= 0: `share` of the probability between is above it.

    Phi(z) = Phi(begin) - share (Phi(begin) - Phi(end)), by logarithms.
    """
    from scipy.special import log_ndtr, ndtri_exp

    first = log_ndtr(begin)
    return ndtri_exp(first + math.log1p(share * math.expm1(log_ndtr(end) - first)))


class UniformLaw(NamedTuple):
    """The same density everywhere."""

    low: float
    high: float

    def draw(self, u, run):
        """Value at the probability u."""
        return self.low + u * (self.high - self.low)

    def reach(self):
        """The bounds."""
        return self.low, self.high


class LogNormalLaw(NamedTuple):
    """A factor; its logarithm is Gaussian."""

    sigma: float

    def draw(self, u, run):
        """Factor at the probability u."""
        from scipy.special import ndtri

        return math.exp(self.sigma * float(ndtri(u)))

    def reach(self):
        """Factors at -+ 3 sigma."""
        return math.exp(-FAR * self.sigma), math.exp(FAR * self.sigma)


class ChoiceLaw(NamedTuple):
    """One of several values."""

    values: tuple[Any, ...]
    cumulative: tuple[float, ...]  # probability of this value or one before it

    def draw(self, u, run):
        """The value whose part of the unit interval u lies in."""
        return next(value for value, end in zip(self.values, self.cumulative, strict=True) if u < end)

    def reach(self):
        """Those that can be drawn."""
        starts = (0.0, *self.cumulative[:-1])
        return tuple(v for v, a, b in zip(self.values, starts, self.cumulative, strict=True) if b > a)


class TableLaw(NamedTuple):
    """Value number k for run k."""

    values: tuple[Any, ...]

    def draw(self, u, run):
        """The value of a run; IndexError if the table is too short."""
        return self.values[run]

    def reach(self):
        """All of them."""
        return self.values
