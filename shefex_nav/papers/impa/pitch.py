"""IMPA tables 7 and 11: the mean of pitch with a rolling shutter, reading by reading.

The paper has 1.4 to 4.6 arcsec, growing with the rate, at 2 to 5 deg/s: a twentieth of a pixel. Roll and yaw
have no such mean, nor has any angle with a global shutter, nor have its centroids in table 4. The directions
of the campaign come with both signs, so a late or early instant makes no mean: something has to go one way
for stars that move with the rows and for those that move against them. Each reading here changes one thing of
equations (3) to (22), on the same frames. The spot is that of the joint set.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.onboard.startracker.attitude import davenport
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import field, flight, trackers
from shefex_nav.papers.impa.methods import chain, multipole
from shefex_nav.papers.impa.methods import clusters as cluster
from shefex_nav.papers.impa.methods.as_printed import AS_READ, PRINTED
from shefex_nav.papers.impa.published import ATTITUDE_MEAN_ARCSEC
from shefex_nav.papers.picture import legend_below, tidy
from shefex_nav.records import Reason
from shefex_nav.report import intervals

SHUTTER, CASE = "rolling_shutter", "best_case"
FIRST_RATE = 1  # of field.RATES: 2 deg/s, from which on the paper has a mean


class Way(NamedTuple):
    """One reading of the compensation, the first value as read by us."""

    longer_px: float = 0.0  # of an extent: 1 counts both its ends, 2 the width of a spot too
    row_time: float = (
        1.0  # times s_z dT in (11) to (17); 0: T_exp for all, -1: the sign of (3) as it is printed
    )
    implicit: bool = False  # (22) with the compensated row
    late_rows: float = 0.0  # of the instant, in line times
    border: bool = False  # clusters that the border cuts are used
    first: bool = False  # clusters and instant of the first of the two frames


WAYS = {
    "as read by us": Way(),
    "(7) with both end rows": Way(longer_px=1.0),
    "extents 2 px longer": Way(longer_px=2.0),
    "(11) without dT": Way(row_time=0.0),
    "(11) with the sign of (3) as printed": Way(row_time=-1.0),
    "(22) as printed": Way(implicit=True),
    "instant five rows later": Way(late_rows=5.0),
    "border as printed": Way(border=True),
    "clusters of the first frame": Way(first=True),
}


def moved(times, clusters, rows, shift_px, way):
    """Places of clusters at the frame's instant by `compensate` as a reading has it: (m, 2) px."""
    settings, form = trackers.DETECT.run_length, "implicit" if way.implicit else "explicit"
    times = times._replace(middle_row=times.middle_row + way.late_rows)
    how = {"longer_px": way.longer_px, "row_time": way.row_time}
    return chain.compensated(settings, times, clusters, rows, shift_px, form, **how).xy_px


def pitch_of(case, pair, way):
    """Pitch error of a pair of Clusters, those of the two frames: arcsec, NaN without an attitude."""
    times, number = field.times(SHUTTER), 0 if way.first else 1
    reading = AS_READ._replace(border=PRINTED) if way.border else AS_READ
    found = cluster.fuse(*pair, trackers.DETECT.run_length.fusion_distance)
    one = pair[number]
    cut_off = chain.at_border(one, (field.CAMERA.height_px, field.CAMERA.width_px))[found[:, number]]
    found = found[~cut_off | (reading.border == PRINTED)]
    rows, shift_px = found[:, number], pair[1].xy_px[found[:, 1]] - pair[0].xy_px[found[:, 0]]
    as_read = chain.compensated(trackers.DETECT.run_length, times, one, rows, shift_px)
    flux_dn, order = chain.brightest_first(times, one.energy_dn[rows], as_read)
    u_c = unit_vectors(trackers.MODEL.pinhole, as_read.xy_px[order])
    pairs = field.pairs(False)
    names = multipole.match(trackers.IDENTIFY, trackers.MODEL, pairs, u_c, flux_dn[order])
    if names.reason != Reason.NONE:
        return np.nan
    known = names.star >= 0
    here = order[known]
    places = moved(times, one, rows[here], shift_px[here], way)
    if not np.isfinite(places).all():
        return np.nan
    u_i = pairs.stars.u_i[names.star[known]]
    q_ic = davenport(unit_vectors(trackers.MODEL.pinhole, places), u_i, np.ones(len(u_i)))
    error = trackers.error_of(q_ic, field.attitude_at(case, number))
    return error[0] / trackers.ARCSEC if trackers.is_right(error) else np.nan


def measure(samples, seed, first):
    """Samples first ... of the campaign's pairs: pitch errors (samples, rates, readings) arcsec."""
    rates = field.RATES[FIRST_RATE:]
    out = np.empty((samples, len(rates), len(WAYS)))
    for k, own_seed in enumerate(seed.spawn(samples)):
        for r, (rate, noise) in enumerate(zip(rates, own_seed.spawn(len(rates)), strict=True)):
            case, rng = field.pair(rate, first + k), np.random.default_rng(noise)
            frames = flight.pictures(SHUTTER, case, rng, sigma_px=flight.JOINT.sigma_px)
            pair = [cluster.find(trackers.DETECT, trackers.MODEL, image) for image in frames]
            out[k, r] = [pitch_of(case, pair, way) for way in WAYS.values()]
    return out


def conclude(results):
    """The mean of each reading and rate beside the published one; none is judged: `impa-joint` does that."""
    found, out = np.concatenate(results), []
    published = ATTITUDE_MEAN_ARCSEC[CASE][SHUTTER]["pitch"]
    for w, name in enumerate(WAYS):
        for r, rate in enumerate(field.RATES[FIRST_RATE:]):
            errors = found[:, r, w][np.isfinite(found[:, r, w])]
            if len(errors) > 1:
                condition = f"{name}, {np.degrees(rate):.0f} deg/s, {len(errors)} attitudes of two images"
                given = published[1 + FIRST_RATE + r], float(errors.mean()), intervals.mean(errors)
                out.append(Row("mean of pitch [arcsec]", condition, *given))
    return out


def draw(figure, results, _rows):
    """Mean against rate of each reading, with its standard error, and the published one."""
    found, rates = np.concatenate(results), np.degrees(field.RATES[FIRST_RATE:])
    figure.set_size_inches(9.0, 6.5)
    axis = figure.subplots()
    for case, style in zip(ATTITUDE_MEAN_ARCSEC, ("-", "--"), strict=True):
        values = ATTITUDE_MEAN_ARCSEC[case][SHUTTER]["pitch"][1 + FIRST_RATE :]
        axis.plot(rates, values, style, lw=3.0, color="0.6", label=f"published, {case.replace('_', ' ')}")
    for w, name in enumerate(WAYS):
        mean = np.nanmean(found[..., w], axis=0)
        error = np.nanstd(found[..., w], axis=0) / np.sqrt(np.isfinite(found[..., w]).sum(axis=0))
        beside = rates + 0.03 * (w - 0.5 * len(WAYS))
        axis.errorbar(beside, mean, error, fmt="o-", ms=4, lw=1.0, label=f"simulated, {name}")
    axis.axhline(0.0, color="k", lw=0.5)
    axis.set_xticks(rates)
    axis.set(xlabel="rate [deg/s]", ylabel="mean of pitch, estimate less truth [arcsec]")
    tidy(axis)
    legend_below(figure, axis, 3)


EXPERIMENTS = {
    "impa-pitch": Experiment(
        samples=1040,
        unit="attitudes and directions, at four rates each",
        chunk=26,
        measure=measure,
        conclude=conclude,
        draw=draw,
        designed=True,
        brief=260,
    )
}
