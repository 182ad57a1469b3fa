"""What the IMPA paper does not say, and how much of its success within two images hangs on it.

One thing at a time is changed against the campaign (`impa_flight`): the width of the spot, the magnitudes of
the false objects, and how the magnitude filter is set. Global shutter, the paper's identification with its
own acceptance verified, the same attitudes, directions and noise seeds for all. The campaign's own settings
are not chosen here: this says what the differences to the published tables are made of.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import field, flight, trackers
from shefex_nav.papers.impa.methods import chain
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.rows import calibrated, explained, goal_none, published_share
from shefex_nav.records import Reason

SHUTTER = "global_shutter"
IMAGES = 2
UNIFORM = "uniform V 0 to 5.5"
FAINT_MAG = 0.28  # by which stars look fainter above the threshold, median


JOINT = "the joint set: spot of 0.7 px, V uniform"  # as flown by impa-joint


OTHERWISE = {  # in the joint set than in the campaign's; the best case has no false objects
    flight.CASES[0]: "with the spot of the joint set",
    flight.CASES[1]: "2 things otherwise, the joint set: the spot, and magnitudes of the false objects",
}


class Setting(NamedTuple):
    """What is assumed."""

    words: str
    case: str  # of flight.CASES
    sigma_px: float = field.PSF_SIGMA_PX
    magnitude_tolerance: float = trackers.IDENTIFY.magnitude_tolerance
    brighter_mag: float = 0.0  # correction of the magnitudes before they are held against the catalogue's
    false: str = "of the catalogue"  # or UNIFORM, or "of the frame"


BEST, WORST = flight.CASES
SETTINGS = (
    *(Setting(f"spot of {sigma:g} px", BEST, sigma) for sigma in (field.PSF_SIGMA_PX, 1.0, 0.9, 0.8, 0.6)),
    *(Setting(f"spot of {sigma:g} px", WORST, sigma) for sigma in (field.PSF_SIGMA_PX, 0.8, 0.6)),
    Setting("false objects: V uniform, 0 to 5.5", WORST, false=UNIFORM),
    Setting("false objects: as bright as those of the frame", WORST, false="of the frame"),
    Setting("eps_m 0.5 mag", WORST, magnitude_tolerance=0.5),
    Setting("eps_m 0.3 mag", WORST, magnitude_tolerance=0.3),
    Setting("eps_m 0.5 mag, magnitudes corrected by -0.28", WORST, 1.124, 0.5, FAINT_MAG),
    Setting("eps_m 0.3 mag, magnitudes corrected by -0.28", WORST, 1.124, 0.3, FAINT_MAG),
    Setting("spot of 0.6 px, V uniform, eps_m 0.3, corrected", WORST, 0.6, 0.3, FAINT_MAG, UNIFORM),
    *(Setting(JOINT, case, flight.JOINT.sigma_px, false=UNIFORM) for case in flight.CASES),
)  # fmt: skip


def objects_of(sigma_px, case, seed):
    """Fused objects of the second frame of a simulation with a spot of this width: Detections."""
    rng, times, clusters = np.random.default_rng(seed), field.times(SHUTTER), None
    for image in flight.pictures(SHUTTER, case, rng, sigma_px=sigma_px):
        clusters, fused = chain.objects(trackers.DETECT, trackers.MODEL, times, clusters, image)
    return fused


def false_objects(setting, fused, rng):
    """The 50 false objects as a setting has their magnitudes: False50."""
    false = trackers.false_objects(rng)
    if setting.false == UNIFORM:
        return false._replace(vmag=rng.uniform(0.0, IMPA["camera"]["catalogue_mag"], len(false.vmag)))
    if setting.false == "of the frame" and len(fused.flux_dn):
        own = -2.5 * np.log10(fused.flux_dn / trackers.ZERO_FLUX_DN)
        return false._replace(vmag=rng.choice(own, len(false.vmag)))
    return false


def outcome(setting, fused, case, false_seed):
    """1: right, 0: no attitude, -1: wrong."""
    if setting.case == WORST:
        false = false_objects(setting, fused, np.random.default_rng(false_seed))
        fused = trackers.with_false(fused, false, case.omega_c)
    settings = replace(trackers.IDENTIFY, magnitude_tolerance=setting.magnitude_tolerance)
    zero_flux = trackers.ZERO_FLUX_DN * 10.0 ** (-0.4 * setting.brighter_mag)
    camera = trackers.MODEL._replace(zero_flux=zero_flux)
    found, q_ic = chain.attitude(settings, camera, field.pairs(False), fused)
    if found.reason != Reason.NONE:
        return 0
    error = trackers.error_of(q_ic, field.attitude_at(case, IMAGES - 1))
    return 1 if trackers.is_right(error) else -1


def measure(samples, seed):
    """Outcome of each sample at each rate with each setting: (samples, rates, settings) int."""
    out = np.empty((samples, len(field.RATES), len(SETTINGS)), dtype=np.int64)
    for k, own_seed in enumerate(seed.spawn(samples)):
        frame_seed, false_seed, place = own_seed.spawn(3)
        number = int(np.random.default_rng(place).integers(field.PAIRS_OF_ALL))
        for r, rate in enumerate(field.RATES):
            case, fused = field.pair(rate, number), {}
            for s, setting in enumerate(SETTINGS):
                if setting.sigma_px not in fused:
                    fused[setting.sigma_px] = objects_of(setting.sigma_px, case, frame_seed)
                out[k, r, s] = outcome(setting, fused[setting.sigma_px], case, false_seed)
    return out


def conclude(results):
    """Success within two images of each setting and rate, beside the published one."""
    found, by_setting = np.concatenate(results), []
    for s, setting in enumerate(SETTINGS):
        published = IMPA["success_percent_by_images"][setting.case][SHUTTER][IMAGES]
        mine = []
        for r, rate in enumerate(IMPA["protocol"]["rates_deg_s"]):
            here = found[:, r, s]
            condition = f"{setting.case.replace('_', ' ')}, {setting.words}, {rate:g} deg/s"
            given = "success within 2 images", condition, published[1 + r] / 100.0
            how = {"n_published": field.PAIRS_OF_ALL, "better": "more"}
            mine.append(published_share(*given, (here > 0).sum(), len(here), **how))
        by_setting.append((setting, mine))
    joint = {setting.case: mine for setting, mine in by_setting if setting.words == JOINT}
    rows = []
    for setting, mine in by_setting:
        if setting.words == JOINT:  # fitted to the best case alone
            rows += [calibrated(row) for row in mine] if setting.case == BEST else mine
        elif setting[1:] == Setting("", setting.case)[1:]:
            how = {"run": "impa-assumptions/joint", "words": OTHERWISE[setting.case]}
            both = zip(mine, joint[setting.case], strict=True)
            rows += [explained(row, other, **how) for row, other in both]
        else:  # one step of a scan
            rows += [Row(*row[:5]) for row in mine]
    words = "wrong attitudes, all settings; goal: none", "acceptance verified"
    return [*rows, goal_none(*words, (found < 0).reshape(len(found), -1))]


def draw(figure, results, rows):
    """Success against rate, best case on the left, worst case on the right."""
    found = np.concatenate(results)
    rates = IMPA["protocol"]["rates_deg_s"]
    figure.set_layout_engine("constrained")
    figure.set_size_inches(12.0, 5.5)
    for ax, case in zip(figure.subplots(1, 2, sharey=True), flight.CASES, strict=True):
        published = IMPA["success_percent_by_images"][case][SHUTTER][IMAGES][1:]
        ax.plot(rates, published, "k-", lw=2.5, label="published")
        for s, setting in enumerate(SETTINGS):
            if setting.case == case:
                success = 100.0 * (found[:, :, s] > 0).mean(axis=0)
                ax.plot(rates, success, "o-", ms=4, lw=1.2, label=setting.words)
        ax.set(title=case.replace("_", " "), xlabel="rate [deg/s]", ylim=(0.0, 102.0))
        ax.set_xticks(rates)
        ax.grid(alpha=0.3)
        ax.legend(fontsize=8)
    figure.axes[0].set_ylabel("success within two images [%]")


EXPERIMENTS = {
    "impa-assumptions": Experiment(
        samples=260,
        unit="attitudes and directions, at five rates each",
        chunk=5,
        measure=measure,
        conclude=conclude,
        draw=draw,
    )
}
