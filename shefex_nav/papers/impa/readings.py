"""The IMPA chain as it is printed and as we read it, switch by switch: success within two images.

Each switch of `methods.as_printed` alone, all of them, and none, on the same frames, with both shutters and
in both cases, under the joint set of assumptions. Attitudes are believed as the paper believes them.
"""

from functools import partial

import numpy as np

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.onboard.startracker.attitude import davenport
from shefex_nav.papers import verdict
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import field, flight, trackers
from shefex_nav.papers.impa.methods import as_printed, chain
from shefex_nav.papers.impa.methods.as_printed import AS_PRINTED, AS_READ, PRINTED
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.picture import legend_below, tidy
from shefex_nav.papers.rows import calibrated, explained, published_share, share_together
from shefex_nav.records import Reason

IMAGES = 2
SHUTTERS = field.SHUTTERS
READINGS = {
    "as read by us": AS_READ,
    "(32) as printed": AS_READ._replace(magnitude=PRINTED),
    "(41) as printed": AS_READ._replace(votes=PRINTED),
    "border as printed": AS_READ._replace(border=PRINTED),
    "pole order as printed": AS_READ._replace(poles=PRINTED),
    "all as printed": AS_PRINTED,
}
NAMES = tuple(READINGS)
RUN = "impa-readings"
RATES = IMPA["protocol"]["rates_deg_s"]


def outcome(reading, fused, truth):
    """1: right, 0: no attitude, -1: wrong, of a list of objects."""
    pairs = field.pairs(False)
    u_c = unit_vectors(trackers.MODEL.pinhole, fused.xy_px)
    found = as_printed.match(trackers.IDENTIFY, trackers.MODEL, pairs, u_c, fused.flux_dn, reading)
    if found.reason != Reason.NONE:
        return 0
    known = found.star >= 0
    q_ic = davenport(u_c[known], pairs.stars.u_i[found.star[known]], np.ones(known.sum()))
    return 1 if trackers.is_right(trackers.error_of(q_ic, truth)) else -1


def of_frames(shutter, case, seeds):
    """Outcomes of one simulation: (cases, readings)."""
    frame_seed, false_seed = seeds
    rng, times = np.random.default_rng(frame_seed), field.times(shutter)
    images = flight.pictures(shutter, case, rng, sigma_px=flight.JOINT.sigma_px)
    truth = field.attitude_at(case, IMAGES - 1)
    false = trackers.false_objects(np.random.default_rng(false_seed), flight.JOINT.uniform)
    out = np.empty((len(flight.CASES), len(READINGS)), dtype=np.int64)
    find = partial(chain.objects, trackers.DETECT, trackers.MODEL, times)
    before, _ = find(None, images[0])
    lists = {}
    for k, reading in enumerate(READINGS.values()):
        key = reading.border, reading.magnitude
        if key not in lists:
            fused = find(before, images[1], reading)[1]
            lists[key] = fused, trackers.with_false(fused, false, case.omega_c)
        out[:, k] = [outcome(reading, one, truth) for one in lists[key]]
    return out


def measure(samples, seed):
    """Outcomes: (samples, rates, shutters, cases, readings) int."""
    shape = len(RATES), len(SHUTTERS), len(flight.CASES), len(READINGS)
    out = np.empty((samples, *shape), dtype=np.int64)
    for k, own_seed in enumerate(seed.spawn(samples)):
        *seeds, place = own_seed.spawn(3)
        number = int(np.random.default_rng(place).integers(field.PAIRS_OF_ALL))
        for r, rate in enumerate(field.RATES):
            case = field.pair(rate, number)
            for s, shutter in enumerate(SHUTTERS):
                out[k, r, s] = of_frames(shutter, case, seeds)
    return out


def conclude(results):
    """Success of each reading; what differs as we read it is said with the figures of the other readings."""
    found, out = np.concatenate(results), []
    for c, case in enumerate(flight.CASES):
        for s, shutter in enumerate(SHUTTERS):
            for r, rate in enumerate(RATES):
                out += _rows_of(case, shutter, rate, found[:, r, s, c])
    for k, name in enumerate(NAMES):
        out.append(share_together("wrong attitudes", f"{name}, all cases", found[..., k] < 0))
    return out


def _rows_of(case, shutter, rate, outcomes):
    """Rows of one rate; outcomes: (samples, readings)."""
    published = IMPA["success_percent_by_images"][case][shutter][IMAGES][1 + RATES.index(rate)] / 100.0
    place = f"{case.replace('_', ' ')}, {shutter.replace('_', ' ')}, {rate:g} deg/s"
    mine, n = [], len(outcomes)
    for k, name in enumerate(NAMES):
        given = "success within 2 images", f"{place}, {name}", published, int((outcomes[:, k] > 0).sum()), n
        mine.append(published_share(*given, n_published=field.PAIRS_OF_ALL, better="more"))
    ours, *others = mine
    if case == flight.CASES[0] and shutter == SHUTTERS[0]:
        ours = calibrated(ours)  # the joint set was fitted to it
    for name, other in zip(NAMES[1:], others, strict=True):
        ours = explained(ours, other, f"{RUN}/{name}", f"with {name}")
    if ours.verdict == verdict.Verdict.OPEN:
        ours = ours._replace(why=said(mine))
    return [ours, *(Row(*other[:5]) for other in others)]


def said(rows_of_readings):
    """What the other readings give in the place of the first, from their figures: str."""
    shares = {name: 100.0 * one.measured for name, one in zip(NAMES, rows_of_readings, strict=True)}
    others = ", ".join(f"{name} {value:.0f}" for name, value in shares.items() if name != NAMES[0])
    published = 100.0 * rows_of_readings[0].published
    return (
        f"published {published:.0f} %, as read by us {shares[NAMES[0]]:.0f}; {others}: no reading reaches it"
    )


COLOURS = ("#1f5fa8", "#d1622b", "#5f9e3f", "#9c4f96", "#8c6d31", "#202020")
STYLES = ("o-", "s--", "^--", "v--", "D--", "x:")


def draw(figure, results, rows):
    """Success against rate: cases below each other, shutters side by side."""
    figure.set_size_inches(11.0, 8.5)
    of = {(row.quantity, row.condition): row for row in rows}
    axes = figure.subplots(len(flight.CASES), len(SHUTTERS), sharex=True, sharey=True)
    for c, case in enumerate(flight.CASES):
        for s, shutter in enumerate(SHUTTERS):
            axis, place = axes[c, s], f"{case.replace('_', ' ')}, {shutter.replace('_', ' ')}"
            table = IMPA["success_percent_by_images"][case][shutter][IMAGES][1:]
            axis.plot(RATES, table, color="0.6", lw=4.0, label="published")
            for k, (name, style, colour) in enumerate(zip(NAMES, STYLES, COLOURS, strict=True)):
                key = [("success within 2 images", f"{place}, {rate:g} deg/s, {name}") for rate in RATES]
                values = [100.0 * of[one].measured for one in key]
                beside = np.array(RATES) + 0.05 * (k - 2.5)  # many are the same
                axis.plot(beside, values, style, ms=5, lw=1.2, color=colour, label=f"simulated, {name}")
            axis.set(title=place, ylim=(0.0, 103.0))
            axis.set_xticks(RATES)
            tidy(axis)
    for axis in axes[-1]:
        axis.set_xlabel("rate [deg/s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("success within two images [%]")
    legend_below(figure, axes[0, 0], 4)


EXPERIMENTS = {
    RUN: Experiment(
        samples=260,
        unit="attitudes and directions, at five rates and with both shutters each",
        chunk=4,
        measure=measure,
        conclude=conclude,
        draw=draw,
        brief=100,
    )
}
