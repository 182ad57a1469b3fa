"""How well and how often: success, percentiles, star fixes, dispersion. Runs are independent samples.

Figures over time are in `over_time`, what explains them in `sensitivity`, how far one can trust them in
`convergence`. Confidence is 95 % unless something else is said.
"""

import math
from typing import NamedTuple

import numpy as np
from scipy import stats

from shefex_nav.campaign import normality
from shefex_nav.report import intervals
from shefex_nav.report.requirements import words

QUANTILES = (50.0, 95.0, 99.0)
CONFIDENCE = 0.95
FLAT = 1e-9  # km; a dispersion below this is none
FEWEST = 8  # runs of an ellipse: that of 3 is 13 times as long, and says nothing of the dispersion
CURVED_KM = 5.0  # km that the mean of places may lie below them: of more no plane is near
ENTRY = "summary.navigation.at_entry"
ATTITUDE = tuple(f"{ENTRY}.attitude_error_deg.{k}" for k in range(3))  # columns, axis by axis
PLACE = ("latitude_deg", "longitude_deg", "altitude_km")


class Success(NamedTuple):
    """How many of the succeeded runs kept a requirement, of those that can be judged by it."""

    name: str
    limit: float | bool
    unit: str
    passed: int
    of: int
    ci95: tuple | None  # of the probability, Clopper and Pearson; None without runs
    without: int  # of those not passed: runs that do not have the figure

    @property
    def words(self):
        """The limit for people."""
        return words(self.name, self.limit, self.unit)


class Percentile(NamedTuple):
    """A percentile of an error over the runs."""

    percent: float
    value: float
    low: float | None  # of its 95 % interval; None where the sample is too small for that end
    high: float | None


class Spread(NamedTuple):
    """Percentiles of one figure."""

    name: str
    unit: str
    samples: int
    percentiles: tuple  # of Percentile
    worst: float
    worst_run: int


class Share(NamedTuple):
    """A probability with its interval."""

    part: int
    whole: int
    value: float | None
    low: float | None
    high: float | None


class StarFixes(NamedTuple):
    """What the star tracker did."""

    availability: Share  # frames of the window with an attitude; the interval is over runs
    most_gaps: float  # one-sided 95 % bound of the probability of a run with a frame of the window without
    wrong: int  # of the whole flight, as all that follows
    runs_with_wrong: Share
    most_wrong_runs: float | None  # one-sided 95 % bound of the probability of a run with a wrong fix
    most_wrong_fixes: float | None  # likewise of a fix; of none that is wrong, as if each were by itself


class Ellipse(NamedTuple):
    """Dispersion of the true position about its mean, in local axes there."""

    what: str
    samples: int
    latitude_deg: float
    longitude_deg: float
    altitude_km: float
    offsets_km: np.ndarray  # (n, 3) north, east, up of each run
    covariance_km2: np.ndarray  # (3, 3) north, east, up
    semi_axes_km: tuple  # of the horizontal 95 % ellipse, the long one first
    azimuth_deg: float  # of its long axis, from north to east, 0 to 180
    inside: int  # runs in it
    shape: normality.Shape | None = None  # whether the places are normal; None: not tested


# (name, column or columns whose largest size counts, unit)
ERRORS = (
    *((f"attitude {axis} at entry", (column,), "deg") for axis, column in zip("xyz", ATTITUDE, strict=True)),
    ("attitude at entry, worst axis", ATTITUDE, "deg"),
    ("position at entry", (f"{ENTRY}.position_error_m",), "m"),
    ("velocity at entry", (f"{ENTRY}.velocity_error_m_s",), "m/s"),
    ("attitude, rms of the run", ("summary.navigation.attitude_error_deg.rms",), "deg"),
    ("position, rms of the run", ("summary.navigation.position_error_m.rms",), "m"),
    ("velocity, rms of the run", ("summary.navigation.velocity_error_m_s.rms",), "m/s"),
    (
        "star tracker across the boresight, rms",
        ("summary.star_tracker.error_arcsec.cross_axis_rms",),
        "arcsec",
    ),
)


def successes(campaign):
    """Success against each requirement: list of Success, in the order of the requirements."""
    found, result = campaign.judgements, []
    for k, name in enumerate(found.names):
        passed, of = int(found.passed[:, k].sum()), int(found.judgeable[:, k].sum())
        interval = intervals.proportion(passed, of) if of else None
        without = of - int(found.measured[:, k].sum())
        result.append(Success(name, found.limits[k], found.units[k], passed, of, interval, without))
    return result


def errors(campaign):
    """Percentiles of the sizes of the errors over the succeeded runs that have them: list of Spread."""
    result = []
    for name, columns, unit in ERRORS:
        size = np.abs(np.array([campaign.numbers(column) for column in columns])).max(axis=0)
        known = np.isfinite(size) & campaign.succeeded
        if known.any():
            result.append(spread(name, unit, size[known], campaign.runs[known]))
    return result


def spread(name, unit, values, runs):
    """Spread of the values (n,) of some runs (n,)."""
    worst = int(np.argmax(values))
    percentiles = tuple(percentile(values, percent) for percent in QUANTILES)
    return Spread(name, unit, len(values), percentiles, float(values[worst]), int(runs[worst]))


def percentile(values, percent, confidence=CONFIDENCE):
    """Percentile of a sample with the interval of order statistics; an end beyond the sample is None."""
    n, p, tail = len(values), percent / 100.0, 0.5 * (1.0 - confidence)
    low, high = intervals.percentile(values, percent, confidence)
    has_low, has_high = (1.0 - p) ** n <= tail, p**n <= tail
    value = float(np.percentile(values, percent))
    return Percentile(percent, value, low if has_low else None, high if has_high else None)


def star_fixes(campaign):
    """StarFixes of the succeeded runs; None if the star tracker took no frame in the window."""
    good = campaign.succeeded
    solved = campaign.numbers("summary.star_tracker.solved")[good]
    fixes = campaign.numbers("summary.star_tracker.fixes")[good]
    frames = campaign.numbers("summary.star_tracker.in_window")[good]
    wrong = np.nan_to_num(campaign.numbers("summary.star_tracker.wrong")[good])
    if not np.nansum(frames):
        return None
    known = np.isfinite(solved) & np.isfinite(frames)
    n, k = len(wrong), int((wrong > 0).sum())
    runs_with_wrong = Share(k, n, k / n, *intervals.proportion(k, n))
    return StarFixes(
        pooled(solved[known], frames[known]),
        at_most(int((solved < frames)[known].sum()), int(known.sum())),
        int(wrong.sum()),
        runs_with_wrong,
        at_most(k, n),
        _most_of_fixes(wrong, np.nan_to_num(fixes)),
    )


def _most_of_fixes(wrong, fixes):
    """One-sided 95 % bound of the share of wrong fixes, (n,) of each run; None where there is none.

    Runs with wrong ones say how many of a run come together; of none at all nothing says it.
    """
    if not wrong.any():
        return at_most(0, int(fixes.sum()))
    return intervals.clustered(wrong, fixes, 2.0 * CONFIDENCE - 1.0)[1] if len(wrong) > 1 else None


def pooled(parts, wholes):
    """Share of all parts in all wholes, of runs whose parts have something in common.

    Its interval (`intervals.clustered`) needs at least two runs, and says nothing where every run gives the
    very same share.
    """
    part, whole, n = int(parts.sum()), int(wholes.sum()), len(parts)
    ratio = part / whole
    if n < 2 or not (parts - ratio * wholes).any():
        return Share(part, whole, ratio, None, None)
    return Share(part, whole, ratio, *intervals.clustered(parts, wholes, CONFIDENCE))


def at_most(k, n, confidence=CONFIDENCE):
    """One-sided upper bound of a probability after k of n; 0 of n gives nearly 3 / n, the rule of three."""
    if n < 1:
        return None
    return intervals.proportion(k, n, 2.0 * confidence - 1.0)[1]


def ellipses(campaign):
    """Dispersion of the flights at apogee, entry and impact: list of Ellipse, each of FEWEST runs or more."""
    result = []
    for what in ("apogee", "entry", "impact"):
        names = [f"summary.flight.at_{what}.{key}" for key in PLACE]
        places = np.array([campaign.numbers(name) for name in names]).T
        places = places[np.isfinite(places).all(axis=1) & campaign.succeeded]
        if len(places) >= FEWEST and (found := ellipse(what, places)) is not None:
            result.append(found)
    shapes = normality.shapes([one.offsets_km[:, :2] for one in result])
    return [one._replace(shape=shape) for one, shape in zip(result, shapes, strict=True)]


def ellipse(what, places):
    """Ellipse of places (n, 3) latitude [deg], longitude [deg], height [km], n > 2.

    None if all are one, and of places that no plane holds: over so much of the Earth there is no ellipse.

    The 95 % ellipse is the one that holds the next run with that probability if the dispersion is normal: its
    size is Hotelling's 2 (n^2 - 1) / (n (n - 2)) F_{2, n-2}, which tends to chi-square with the number of
    runs (Johnson, Wichern, Applied Multivariate Statistical Analysis, 6th ed., section 5.4).
    """
    from shefex_nav.geometry import wgs84

    angles = np.radians(places[:, :2])
    r_e = np.empty(places.shape)
    for k, (place, height_km) in enumerate(zip(angles, places[:, 2], strict=True)):
        r_e[k] = wgs84.ecef_from_geodetic(*place, 1e3 * height_km)
    mean_e = r_e.mean(axis=0)
    latitude, longitude, height = wgs84.geodetic_from_ecef(mean_e)
    if float(places[:, 2].mean()) - height / 1e3 > CURVED_KM:
        return None
    offsets = (r_e - mean_e) @ wgs84.dcm_en(latitude, longitude) / 1e3 * (1.0, 1.0, -1.0)
    n, covariance = len(places), np.cov(offsets.T)
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    if variances[1] < FLAT**2:
        return None
    scale = 2.0 * (n * n - 1.0) / (n * (n - 2.0)) * float(stats.f.ppf(CONFIDENCE, 2, n - 2))
    along = offsets[:, :2] @ axes
    inside = (along**2 / np.maximum(variances, FLAT**2)).sum(axis=1) <= scale
    minor, major = np.sqrt(scale * np.maximum(variances, 0.0))
    azimuth = math.degrees(math.atan2(axes[1, 1], axes[0, 1])) % 180.0
    return Ellipse(
        what, n, math.degrees(latitude), math.degrees(longitude), height / 1e3, offsets, covariance,
        (float(major), float(minor)), azimuth, int(inside.sum()),
    )  # fmt: skip
