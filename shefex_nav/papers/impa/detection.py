"""IMPA figure 12: the faintest star that is found, by the model of section 4.2 and on simulated frames.

The model, equations (24) to (30): a star at the angle alpha from the axis of rotation spreads its light over
r_psf l / IFOV pixels, l = omega sin(alpha) dt, and is found while each of them gets tau_pre. As in the paper,
alpha = beta - FOV / 2: beta is the angle between the axis of rotation and the boresight, and the best place
on the detector is the edge nearest to the axis. The paper's betas are not in its text: those here are [E].

r_psf = 3 says how wide a streak is: its light in a pixel of its middle line is a third of its light per pixel
of length. For a Gaussian spot of sigma that share is, averaged over where the line runs in its pixel,
int erf(...) = `streak_share`; a sigma of 1.124 px gives a third.

In the simulation artificial stars stand along that edge, of magnitudes around the model's; the magnitude at
which half of them are found is fitted by a normal distribution function (probit) in the difference to the
model at each star's own alpha.
"""

import numpy as np
from scipy import integrate, optimize
from scipy.special import erf, log_ndtr

from shefex_nav.geometry.pinhole import unit_vectors
from shefex_nav.geometry.rotation import dcm_from_quat
from shefex_nav.geometry.streak import place_at
from shefex_nav.papers.experiment import Experiment, Row
from shefex_nav.papers.impa import field, trackers
from shefex_nav.papers.impa.methods import clusters
from shefex_nav.papers.impa.published import IMPA
from shefex_nav.papers.picture import COLOURS, points, tidy
from shefex_nav.papers.rows import given, goal
from shefex_nav.papers.stills import electrons, random_attitude, still
from shefex_nav.report import intervals

RATES = tuple(float(rate) for rate in IMPA["protocol"]["rates_deg_s"])
BETAS = (30.0, 60.0, 90.0)  # deg [E]
HALF_FIELD = np.radians(0.5 * IMPA["camera"]["fov_deg"][0])
TAU = IMPA["camera"]["tau_pre_electrons"]
R_PSF = IMPA["camera"]["psf_diameter_px"]
FAINTEST_SHOWN = 6.0  # of the paper's figure
# where the artificial stars stand, from the middle, and how far apart: no streak may run into the next one,
# at 5 deg/s and 90 deg they are 50 px long and lie one behind the other
EDGE_PX, APART_PX, JITTER_PX, N_STARS = 478.0, 78.0, 5.0, 12
SPREAD = (-1.0, 3.0)  # mag, of the artificial stars around the model; ours finds fainter ones
FOUND_PX = 2.0  # a cluster this near to the path of a star is that star's
TOLERANCE = 0.3  # mag
METHODS = ("IMPA's threshold", "rate-aided")  # on frames that are simulated here


def streak_share(sigma_px):
    """Light of a pixel on a streak's middle line over its light per pixel of length, mean over the line."""
    scale = 1.0 / (np.sqrt(2.0) * sigma_px)
    share = integrate.quad(lambda d: 0.5 * (erf((0.5 - d) * scale) + erf((0.5 + d) * scale)), -0.5, 0.5)
    return share[0]


def model_magnitude(rate_deg_s, alpha):
    """Faintest magnitude by equations (28) and (30), without the exposure: it cancels.

    rate_deg_s, alpha : float deg/s, rad; arrays welcome
    """
    ifov = np.radians(IMPA["camera"]["fov_deg"][0]) / IMPA["camera"]["width_px"]
    rate = np.radians(rate_deg_s)
    peak = ifov * IMPA["camera"]["zero_mag_electrons_s"] / (R_PSF * np.sin(alpha) * rate)
    return 2.5 * np.log10(peak / TAU)


def frame_of(rate_deg_s, beta_deg, rng):
    """One frame of artificial stars.

    Returns
    -------
    difference : (n,) mag, of each star to the model at its place
    found : (2, n) bool by METHODS
    """
    side = rng.integers(4) * 0.5 * np.pi  # which edge is nearest to the axis
    toward, beside = np.array([np.cos(side), np.sin(side)]), np.array([-np.sin(side), np.cos(side)])
    beta = np.radians(beta_deg)
    axis = np.array([*(np.sin(beta) * toward), np.cos(beta)])
    omega_c = np.radians(rate_deg_s) * axis
    camera, hole = field.camera("global_shutter"), field.CAMERA
    steps = (np.arange(N_STARS) - 0.5 * (N_STARS - 1)) * APART_PX
    jitter = rng.uniform(-JITTER_PX, JITTER_PX, (N_STARS, 2))
    xy_px = np.array([hole.cx_px, hole.cy_px]) + EDGE_PX * toward + steps[:, None] * beside + jitter
    u_c = unit_vectors(hole, np.ascontiguousarray(xy_px))
    alpha = np.arccos(np.clip(u_c @ axis, -1.0, 1.0))
    model = model_magnitude(rate_deg_s, alpha)
    vmag = model + rng.uniform(*SPREAD, N_STARS)
    q_ic = random_attitude(rng)
    light = electrons(camera, vmag)
    image, _ = still(camera, u_c @ dcm_from_quat(q_ic).T, light, q_ic, rng, omega_c=omega_c)
    published = clusters.find(trackers.DETECT, trackers.MODEL, image).xy_px
    gyro = omega_c + field.RATE_ERROR * rng.standard_normal(3)
    ours = trackers.streaks_of(image, gyro, field.RATE_ERROR**2 * np.eye(3), camera.times).xy_px
    found = [[near_path(place, omega_c, xy) for xy in xy_px] for place in (published, ours)]
    return vmag - model, np.array(found)


def near_path(places, omega_c, xy_px):
    """Whether one of the places is on the path of a star during the exposure."""
    if not len(places):
        return False
    t_s = np.linspace(-0.5, 0.5, 41) * field.EXPOSURE_S
    path = np.array([place_at(field.CAMERA, omega_c, xy_px[0], xy_px[1], t) for t in t_s])
    a, b = path[:-1, None], path[1:, None]
    along = np.clip(((places - a) * (b - a)).sum(axis=2) / ((b - a) ** 2).sum(axis=2), 0.0, 1.0)
    return bool((np.linalg.norm(places - a - along[..., None] * (b - a), axis=2) < FOUND_PX).any())


def half_found(difference, found):
    """Difference to the model at which half of the stars are found (probit): mag; NaN if all or none are."""
    difference, found = difference.ravel(), found.ravel()
    if found.all() or not found.any():
        return np.nan

    def unlikely(parameters):
        z = (parameters[0] - difference) * np.exp(parameters[1])
        return -np.where(found, log_ndtr(z), log_ndtr(-z)).sum()

    start = np.array([difference[found].mean() + 0.5, np.log(4.0)])
    fit = optimize.minimize(unlikely, start, method="Nelder-Mead")
    return float(fit.x[0])


def measure(samples, seed):
    """Differences (samples, rates, betas, stars) and found (samples, 2, rates, betas, stars)."""
    rng = np.random.default_rng(seed)
    difference, found = [], []
    for _ in range(samples):
        frames = [[frame_of(rate, beta, rng) for beta in BETAS] for rate in RATES]
        difference.append([[one[0] for one in row] for row in frames])
        found.append([[[one[1][m] for one in row] for row in frames] for m in range(len(METHODS))])
    return {"difference": np.array(difference), "found": np.array(found)}


def conclude(results):
    """Rows of the PSF and of the faintest magnitudes."""
    rng = np.random.default_rng(0)
    difference = np.concatenate([result["difference"] for result in results])
    found = np.concatenate([result["found"] for result in results])
    width = 1.0 / streak_share(field.PSF_SIGMA_PX)
    spot = f"Gaussian of {field.PSF_SIGMA_PX:g} px"
    rows = [given("width of a streak, r_psf [px]", spot, R_PSF, round(width, 2))]
    for m, method in enumerate(METHODS):
        for b, beta in enumerate(BETAS):
            for r, rate in enumerate(RATES):
                columns = difference[:, r, b], found[:, m, r, b]
                model = float(model_magnitude(rate, np.radians(beta) - HALF_FIELD))
                value = half_found(*columns)
                interval = None
                if len(difference) > 1 and np.isfinite(value):
                    interval = intervals.bootstrap(half_found, columns, rng, resamples=200)
                condition = f"{rate:g} deg/s, axis {beta:g} deg from the boresight"
                rows += _rows_of(method, condition, model, value, interval, len(difference))
    return rows


def _rows_of(method, condition, model, value, interval, n):
    """The magnitude; and of the published threshold how much fainter it is than the published equations say.

    The paper prints its figure 12 without numbers: the model's are its equations worked out here, so that the
    difference is a goal of the simulation and no published figure.
    """
    ends = None if interval is None else tuple(model + end for end in interval)
    found = [Row(f"{method}: {FAINTEST}", condition, None, model + value, ends)]
    if method == METHODS[0]:
        quantity, criterion = f"{method}: {LESS_MODEL}", {"least": -TOLERANCE, "most": TOLERANCE}
        measured = (None, value, interval, n)
        found.append(goal(quantity, condition, *measured, **criterion, resolves=TOLERANCE))
    return found


FAINTEST = "faintest magnitude found in half the cases"
LESS_MODEL = "fainter than equations (28) and (30) [mag]; goal: within 0.3"


def draw(figure, _results, rows):
    """As figure 12: the model as lines, the simulation as points with intervals; ours beside."""
    figure.set_size_inches(8.5, 5.5)
    axis = figure.subplots()
    rate = np.linspace(0.3, 5.2, 200)
    for beta, colour in zip(BETAS, COLOURS, strict=False):
        model = model_magnitude(rate, np.radians(beta) - HALF_FIELD)
        axis.plot(
            rate,
            np.minimum(model, FAINTEST_SHOWN),
            color=colour,
            lw=1.2,
            label=f"equations (28), (30), {beta:g} deg",
        )
    for method, style in zip(METHODS, ("o", "s"), strict=True):
        for beta, colour in zip(BETAS, COLOURS, strict=False):
            mine = [row for row in rows if row.quantity == f"{method}: {FAINTEST}"]
            mine = [row for row in mine if row.condition.endswith(f"axis {beta:g} deg from the boresight")]
            look = {"color": colour, "ms": 5, "mfc": colour if style == "o" else "none", "capsize": 2}
            points(axis, RATES, mine, style, label=f"simulated, {method}, {beta:g} deg", **look)
    axis.set_ylim(top=axis.get_ylim()[1] + 1.2)  # room for the legend
    axis.set(xlabel="rate [deg/s]", ylabel="faintest magnitude found in half the cases")
    tidy(axis)
    axis.legend(
        loc="upper right",
        frameon=False,
        fontsize=8,
        ncols=3,
        title="angle between axis and boresight",
        title_fontsize=9,
    )


EXPERIMENTS = {
    "impa-detection": Experiment(
        samples=60,
        unit="frames for each of 5 rates and 3 axes",
        chunk=5,
        measure=measure,
        conclude=conclude,
        draw=draw,
    ),
}
