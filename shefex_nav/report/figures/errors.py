"""Errors of the navigation inside plus and minus three of its own standard deviations.

Position and velocity in local level axes of the true position, attitude about the body axes (a rocket stands
and flies upright, where roll, pitch and heading are not defined); of a log of external data, roll, pitch and
heading. What is filled is where the filter says that 99.7 % of the errors lie.
"""

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.environment.constants import STANDARD_GRAVITY
from shefex_nav.geometry import frames, rotation
from shefex_nav.onboard.navigation.quantity import ATTITUDE, about
from shefex_nav.records import Reason
from shefex_nav.report import local_level
from shefex_nav.report.figures import style
from shefex_nav.report.figures.series import cut_about
from shefex_nav.report.navigation_errors import navigation_errors, normalised_errors
from shefex_nav.report.pairing import at_rows, same_times
from shefex_nav.report.track import earth_fixed

_DEG = np.degrees(1.0)
_MGEE = 1e-3 * STANDARD_GRAVITY  # m/s^2
_NED = ("north", "east", "down")
_COLOURS = (style.BLUE, style.RED, style.GREEN)


@style.styled
def attitude(data):
    """Attitude error, of all and since the first star fix. RunData -> Figure; None without truth."""
    if local_level.is_replay(data):
        t_s, error, _, sigma_t_s, sigma = local_level.errors_and_sigmas(data)
        names, columns = ("roll", "pitch", "heading"), slice(6, 9)
        words = "Attitude error: roll, pitch and heading"
        return _three(
            data, words, names, "deg", (t_s, error[:, columns] * _DEG, sigma_t_s, sigma[:, columns] * _DEG)
        )
    errors = navigation_errors(data)
    sigma_t_s, _, sigma = normalised_errors(data, errors)
    names = tuple(f"about {axis}" for axis in "xyz")
    series = errors.t_s, errors.attitude_b * _DEG, sigma_t_s, sigma[:, 6:] * _DEG
    return _three(data, "Attitude error about the body axes", names, "deg", series)


@style.styled
def velocity(data):
    """Velocity error north, east, down. RunData -> Figure; None without truth."""
    return _three(data, "Velocity error in local level axes", _NED, "m/s", level(data)[1])


@style.styled
def position(data):
    """Position error north, east, down. RunData -> Figure; None without truth."""
    return _three(data, "Position error in local level axes", _NED, "m", level(data)[0])


def level(data):
    """Errors of position [m] and velocity [m/s] north, east, down, as `local_level.errors` has them.

    Without its attitude, and without its kernels, which take long to compile. Returns two of t_s (N,), error
    (N, 3), sigma_t_s (K,), sigma (K, 3).
    """
    i, j = same_times(data.truth.t_s, data.nav.t_s)
    chosen = at_rows(data.truth, i)
    C_ni = _level_axes(data.mission.earth, chosen)
    dr_i = chosen.r_i - data.nav.r_i[j]
    omega_ie_i = frames.omega_ie_i(data.mission.earth)
    dv_i = chosen.v_i - data.nav.v_i[j] - np.cross(omega_ie_i, dr_i)  # relative to the turning Earth
    a, b = same_times(chosen.t_s, data.covariance.t_s)
    P = data.covariance.P[b]
    T = np.concatenate([-rotation.skew(omega_ie_i), np.eye(3)], axis=1)  # (3, 6): of dr and dv
    out = []
    for error, covariance in ((dr_i, P[:, :3, :3]), (dv_i, T @ P[:, :6, :6] @ T.T)):
        turned = C_ni[a] @ covariance @ np.swapaxes(C_ni[a], 1, 2)
        sigma = np.sqrt(np.einsum("kii->ki", turned))
        out.append((chosen.t_s, np.einsum("kij,kj->ki", C_ni, error), chosen.t_s[a], sigma))
    return tuple(out)


def _level_axes(earth, truth):
    """C_ni at every sample of truth: (N, 3, 3)."""
    track = earth_fixed(earth, truth)
    angle = earth.angle_0 + earth.rate * truth.t_s
    c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    C_qr = np.array([[c, -s, zero], [s, c, zero], [zero, zero, one]]).transpose(2, 0, 1)
    c_lat, s_lat = np.cos(track.latitude), np.sin(track.latitude)
    c_lon, s_lon = np.cos(track.longitude), np.sin(track.longitude)
    C_ne = np.array(
        [
            [-s_lat * c_lon, -s_lat * s_lon, c_lat],
            [-s_lon, c_lon, zero],
            [-c_lat * c_lon, -c_lat * s_lon, -s_lat],
        ]
    ).transpose(2, 0, 1)
    return C_ne @ np.swapaxes(earth.C_iq @ C_qr @ earth.C_re, 1, 2)


def aided_since(data):
    """Mission time of the first star fix that the filter used; None without any."""
    used = (gate.t_s for gate in data.gates if about(gate.sensor) is ATTITUDE and gate.accepted)
    return next(used, None)


def part_since(data):
    """The same, of a log that has more than a second before and after it; otherwise None."""
    since_s, (begin_s, end_s) = aided_since(data), style.whole(data)
    return since_s if since_s is not None and begin_s + 1.0 < since_s < end_s - 1.0 else None


def cut_by_stars(axes, data, band, error):
    """End the scale of an attitude where the time with star fixes can be seen, and say what lies beyond.

    band : times (n,) s and 3 sigma (n,) deg;  error : (m,) deg
    """
    fixes_s = [fix.t_valid_s for fix in data.star_fixes if fix.reason == Reason.NONE]
    (t_s, three), size = band, np.abs(error)
    found = cut_about(three[t_s <= max(fixes_s, default=np.inf)], np.concatenate([three, size]))
    if found is None:
        return
    axes.set_ylim(-found.top, found.top)
    share, largest = 100.0 * np.mean(size > found.top), np.nanmax(size, initial=0.0)
    words = f"▲ beyond: 3 σ to {np.nanmax(three):.3g} deg"
    if share > 0.0:
        words += f", {'under 1' if share < 1.0 else f'{share:.0f}'} % of the errors, to {largest:.3g} deg"
    axes.text(
        0.99, 0.94, words, transform=axes.transAxes, ha="right", va="top", fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0},
    )  # fmt: skip


def _three(data, words, names, unit, series):
    """Three errors over time; a second column since the first star fix, at its own scale."""
    t_s, error, sigma_t_s, sigma = series
    if not len(t_s):
        return None
    since_s, whole = part_since(data), style.whole(data)
    heads, spans_s = None, [whole]
    if since_s is not None:
        heads, spans_s = ["the whole log", "since the first star fix"], [whole, (since_s, whole[1])]
    figure, rows = style.panels(
        data, 3, f"{words}, with what the filter says of it (3 σ)", columns=len(spans_s), heads=heads,
        spans_s=spans_s,
    )  # fmt: skip
    for k, name in enumerate(names):
        for c, span_s in enumerate(spans_s):
            axes = rows[k, c]
            late, late_sigma = t_s >= span_s[0] - SAME_S, sigma_t_s >= span_s[0] - SAME_S
            style.band(axes, sigma_t_s[late_sigma], sigma[late_sigma, k])
            style.curve(axes, t_s[late], error[late, k], color=_COLOURS[k], label=f"error, {name}")
            settled = late & (t_s > span_s[0] + 0.02 * (span_s[1] - span_s[0])) if c else late
            settled_sigma = late_sigma & (sigma_t_s >= t_s[settled][0]) if settled.any() else late_sigma
            style.limits(
                axes, [error[settled, k], 3.0 * sigma[settled_sigma, k], -3.0 * sigma[settled_sigma, k]]
            )
            if c and unit == "deg":  # stars give the attitude; position and velocity are of GPS
                cut_by_stars(axes, data, (sigma_t_s[late_sigma], 3.0 * sigma[late_sigma, k]), error[late, k])
        rows[k, 0].set_ylabel(f"{name} [{unit}]")
    style.legend_above(rows[0, 0])
    return figure


@style.styled
def biases(data):
    """Estimated biases of the IMU with 3 sigma, where they are known. RunData -> Figure; None without any.

    The log does not hold the true biases, so these are estimates, not errors.
    """
    covariance = data.covariance
    if not any(np.isfinite(one).any() for one in (covariance.gyro_bias, covariance.accel_bias)):
        return None
    band = ", ±3 σ about the estimate" if np.isfinite(covariance.sigma[:, :6]).any() else ""
    words = f"Biases of the IMU as estimated{band} (true ones: not in the log)"
    if not band:
        words = f"{words}; no σ of them is given"
    spans_s = [style.whole(data)] * 2
    heads = ["gyros [deg/h]", "accelerometers [mgee]"]
    figure, rows = style.panels(data, 3, words, columns=2, heads=heads, spans_s=spans_s)
    gyro = covariance.gyro_bias * _DEG * 3600.0, covariance.sigma[:, :3] * _DEG * 3600.0
    accel = covariance.accel_bias / _MGEE, covariance.sigma[:, 3:6] / _MGEE
    for c, (estimate, sigma) in enumerate((gyro, accel)):
        for k, axis in enumerate("xyz"):
            style.band(rows[k, c], covariance.t_s, sigma[:, k], centre=estimate[:, k])
            style.curve(
                rows[k, c], covariance.t_s, estimate[:, k], color=_COLOURS[k], label=f"{axis}, estimate"
            )
            rows[k, c].axhline(0.0, color=style.GREY, lw=0.6)
            rows[k, 0].set_ylabel(axis)
    return figure
