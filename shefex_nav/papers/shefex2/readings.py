"""SHEFEX section 4, success against rate: what each part of the chain that the text leaves open does.

"Most off all the images with smear of corresponding to angular rates of 2 deg/s or less where successful
identified. However, for angular rates greater than 4 deg/s the stars could be rarely identified." The images
are of the night sky, "processed using the uniform Hipparcos catalog". Each reading has one thing otherwise
than the chain of that sentence, all solve the same stars; the one in flight has all of the scenario
`shefex2_as_flown`; the verified one has a tolerance of the angle, as there is none of its cosine when the
whole field decides. Frames are exposed for 50 ms, from which the control never goes away (`shefex-rates`).
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.onboard.startracker.objects import detect
from shefex_nav.papers import rows as row
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.picture import COLOURS, points, tidy
from shefex_nav.papers.shefex2 import chain, end_to_end, rates
from shefex_nav.papers.shefex2.frames import MODEL, SPACE
from shefex_nav.papers.stills import StillCamera, electrons, random_attitude, still
from shefex_nav.report import intervals

RATES = rates.RATES
PRINTED = chain.NIGHT_SKY
NEAR = 0.97  # cosine, stars that are drawn: more than half of the field of view


class Case(NamedTuple):
    """A reading, and what it sees."""

    reading: chain.Reading
    camera: StillCamera
    false_objects: bool = True


def _camera(place, exposure_s=rates.NOMINAL_S, spot_px=SPACE.sigma_psf_px):
    return rates.camera_at(exposure_s, place)._replace(sigma_psf_px=spot_px)


def _otherwise(**settings):
    """The printed chain with other settings of its detection, on the ground."""
    return Case(PRINTED._replace(detection=replace(PRINTED.detection, **settings)), GROUND)


GROUND, IN_SPACE = _camera(end_to_end.GROUND), _camera(SPACE)
READINGS = {
    "as printed": Case(PRINTED, GROUND),
    **{f"threshold {sigma} sigma": _otherwise(seed_sigma=float(sigma)) for sigma in (4, 5, 7, 8)},
    "three pixels at least": _otherwise(fewest_pixels=chain.FLOWN.fewest_pixels),
    "sums of 3x3 pixels": Case(PRINTED._replace(detection=chain.BLOCKS), GROUND),
    "combined catalogue": Case(PRINTED._replace(pairs=chain.flown_pairs), GROUND),
    "verified, by angle": Case(PRINTED._replace(verified=True), GROUND),
    "35 ms": Case(PRINTED, _camera(end_to_end.GROUND, rates.CONTROL.shortest)),
    "spot of 0.6 px": Case(PRINTED, _camera(end_to_end.GROUND, spot_px=0.6)),
    "spot of 1.0 px": Case(PRINTED, _camera(end_to_end.GROUND, spot_px=1.0)),
    "no false objects": Case(PRINTED, GROUND, false_objects=False),
    "in space": Case(PRINTED, IN_SPACE),
    "in flight": Case(chain.Reading(chain.FLOWN, chain.flown_pairs), IN_SPACE),
}
NAMES = tuple(READINGS)
RUN = "shefex-readings"
SUCCESS, WRONG = "success within one picture", "share of wrong attitudes"


def measure(samples, seed):
    """Verdicts (1 solved, 0 not, -1 wrong): {'verdicts': (samples, readings, rates) int}."""
    out = np.empty((samples, len(READINGS), len(RATES)), dtype=np.int64)
    for k, own in enumerate(seed.spawn(samples)):
        place_seed, *noise_seeds = own.spawn(1 + len(RATES))
        rng = np.random.default_rng(place_seed)
        q_ic, sky = random_attitude(rng), end_to_end.sky_of(rng)
        angle = rng.uniform(0.0, 2.0 * np.pi)
        for r, rate in enumerate(RATES):
            omega_c = np.radians(rate) * np.array([np.cos(angle), np.sin(angle), 0.0])
            out[k, :, r] = _of_frame(sky, q_ic, omega_c, noise_seeds[r])
    return {"verdicts": out}


def _of_frame(sky, q_ic, omega_c, noise_seed):
    """Verdict of each reading: (readings,). Those with one camera share a picture and its objects."""
    images, found, out = {}, {}, []
    for case in READINGS.values():
        seen = case.camera, case.false_objects
        if seen not in images:
            images[seen] = _picture(*seen, sky, q_ic, omega_c, np.random.default_rng(noise_seed))
        key = (*seen, case.reading.detection)
        if key not in found:
            found[key], _ = detect(case.reading.detection, MODEL, images[seen])
        out.append(end_to_end.verdict(chain.attitude(case.reading, found[key]), q_ic))
    return out


def _picture(camera, false_objects, sky, q_ic, omega_c, rng):
    """A frame of the sky; its last FALSE_OBJECTS are no stars."""
    u_i, magnitudes = (part if false_objects else part[: -end_to_end.FALSE_OBJECTS] for part in sky)
    near = u_i @ dcm_from_quat(q_ic)[:, 2] > NEAR
    return still(camera, u_i[near], electrons(camera, magnitudes[near]), q_ic, rng, omega_c=omega_c)[0]


def conclude(results):
    """Success of each reading; of the others by how much it is another one, on the same pictures."""
    verdicts = np.concatenate([result["verdicts"] for result in results])
    out = []
    for k, name in enumerate(NAMES):
        for r, rate in enumerate(RATES):
            out.append(_success_row(name, rate, verdicts[:, k, r] == 1))
        if k:
            out.append(_change_row(name, (verdicts[:, k] == 1).astype(float) - (verdicts[:, 0] == 1)))
        out.append(row.share_together(WRONG, f"{name}, all rates", verdicts[:, k] == -1))
    return out


def _success_row(name, rate, solved):
    """Success of a reading at a rate; what the sentence says of it is asked of the printed one alone."""
    k, n, said = int(solved.sum()), len(solved), rates.said_of(rate)
    condition = f"{name}, {rate:g} deg/s"
    if name != NAMES[0] or said is None:
        return row.share(SUCCESS, condition, k, n)
    given = None, k / n, row.intervals.proportion(k, n), n
    return row.calibrated(row.statement(f"{SUCCESS}; published: {said[0]}", condition, *given, **said[1]))


def _change_row(name, change):
    """Mean change of the success over all rates, of (samples, rates) pairs of pictures."""
    each = change.mean(axis=1)
    interval = intervals.mean(each) if len(each) > 1 and each.any() else None
    return Row(
        "change of success against as printed", f"{name}, all rates", None, float(each.mean()), interval
    )


PANELS = (  # what is drawn beside each other
    ("threshold", ("threshold 4 sigma", "threshold 5 sigma", "threshold 7 sigma", "threshold 8 sigma")),
    ("scan, catalogue, acceptance", ("three pixels at least", "sums of 3x3 pixels", "combined catalogue",
                                     "verified, by angle")),
    ("picture", ("35 ms", "spot of 0.6 px", "spot of 1.0 px", "no false objects")),
    ("place", ("in space", "in flight")),
)  # fmt: skip


def draw(figure, _results, rows):
    """Success against the rate, four groups of readings; shaded what the paper's sentence leaves."""
    figure.set_size_inches(11.0, 9.0)
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    of = {one.condition: one for one in rows if one.quantity.startswith(SUCCESS)}
    for axis, (title, names) in zip(axes.ravel(), PANELS, strict=True):
        rates.shade(axis)
        for n, name in enumerate((NAMES[0], *names)):
            mine = [of[f"{name}, {rate:g} deg/s"] for rate in RATES]
            style, look = "o-" if n == 0 else "s--", {"ms": 4, "lw": 1.3, "capsize": 2}
            beside = np.array(RATES) + 0.04 * (n - 2)  # many are nearly the same
            points(axis, beside, mine, style, 100.0, color=COLOURS[n], label=f"simulated, {name}", **look)
        axis.set_ylim(0.0, 103.0)
        axis.set_title(title, loc="left", fontsize=10)
        axis.legend(fontsize=8, loc="lower left", frameon=False)  # nothing fails there
        tidy(axis)
    for axis in axes[-1]:
        axis.set_xlabel("rate [deg/s]")
    for axis in axes[:, 0]:
        axis.set_ylabel("pictures with a right attitude [%]")


EXPERIMENTS = {
    RUN: Experiment(
        samples=500,
        unit="attitudes, each at six rates",
        chunk=10,
        measure=measure,
        conclude=conclude,
        draw=draw,
        brief=200,
    )
}
