"""The sky that the star camera saw: where it looked, the Sun, the Earth's limb, and what they exclude."""

from typing import NamedTuple

import numpy as np

from shefex_nav.clock import SAME_S
from shefex_nav.geometry import distortion, frames, rotation, wgs84
from shefex_nav.records import Reason
from shefex_nav.report.configured import configured
from shefex_nav.report.figures import style

_ALL_SKY_VMAG, _FIELD_VMAG = 3.5, 6.0  # faintest stars drawn
_LIMB_POINTS = 181
_GRID = (61, 121)  # declinations and right ascensions at which exclusion is asked for
_LEAST_FIELD, _LARGEST_FIELD = np.radians(6.0), np.radians(50.0)
_SHARE = 0.9  # of the frames that the closer map shows
_PATH = (  # solved, colour, name, size: wide below and narrow above, where the path comes by a second time
    (False, style.RED, "no fix", 5.0),
    (True, style.BLUE, "fix", 2.2),
)


class SkyMap(NamedTuple):
    """What is on the map."""

    t_s: np.ndarray  # (m,) of the frames
    boresight_i: np.ndarray  # (m, 3)
    solved: np.ndarray  # (m,) bool
    sun_hidden: np.ndarray  # (m,) bool, by the Earth: then it excludes nothing
    sun_i: np.ndarray  # (3,)
    limits: object  # configured.Configured


class Limb(NamedTuple):
    """The Earth's edge at one instant."""

    t_s: float
    r_e: np.ndarray  # (3,) m
    C_ie: np.ndarray  # (3, 3)


def around(data):
    """SkyMap of a RunData; None without frames."""
    frames_ = data.frame_truths
    if not frames_:
        return None
    solved = {fix.number for fix in data.star_fixes if fix.reason == Reason.NONE}
    return SkyMap(
        np.array([frame.t_valid_s for frame in frames_]),
        np.array([rotation.dcm_from_quat(frame.q_ic)[:, 2] for frame in frames_]),
        np.array([frame.number in solved for frame in frames_]),
        np.array([frame.sun_hidden for frame in frames_], dtype=bool),
        _sun(data.mission),
        configured(data),
    )


def _sun(mission):
    """Direction of the Sun; of the epoch where the log does not say."""
    if np.isfinite(mission.sun_i).all():
        return mission.sun_i
    from shefex_nav.environment import ephemeris

    return ephemeris.sky_bodies(mission.epoch_utc).sun_u_i


def limb(data, t_s):
    """Limb at the sample of truth next to a mission time."""
    k = min(int(np.searchsorted(data.truth.t_s, t_s - SAME_S)), len(data.truth.t_s) - 1)
    C_ie = frames.dcm_ie(data.mission.earth, float(data.truth.t_s[k]))
    return Limb(float(data.truth.t_s[k]), np.ascontiguousarray(C_ie.T) @ data.truth.r_i[k], C_ie)


def limb_line(edge, above_rad=0.0):
    """Directions along the Earth's limb, or so far above it: (n, 3) in inertial axes."""
    nadir = -edge.r_e / np.linalg.norm(edge.r_e)
    first = np.cross(nadir, np.eye(3)[np.argmin(np.abs(nadir))])
    first /= np.linalg.norm(first)
    around = np.linspace(0.0, 2.0 * np.pi, _LIMB_POINTS)
    across = np.outer(np.cos(around), first) + np.outer(np.sin(around), np.cross(nadir, first))
    from_nadir = np.array([0.5 * np.pi - wgs84.limb_angle(edge.r_e, a) for a in across]) + above_rad
    line_e = np.cos(from_nadir)[:, None] * nadir + np.sin(from_nadir)[:, None] * across
    return line_e @ edge.C_ie.T


def hammer(u_i, middle_rad):
    """Hammer's equal-area map of the sky, seen from inside: east is left. (..., 3) -> (..., 2)

    middle_rad : right ascension in the middle (Snyder, Map Projections, 1987, p. 232, of Hammer-Aitoff).
    """
    longitude = np.arctan2(u_i[..., 1], u_i[..., 0]) - middle_rad
    longitude = (longitude + np.pi) % (2.0 * np.pi) - np.pi
    latitude = np.arcsin(np.clip(u_i[..., 2], -1.0, 1.0))
    scale = np.sqrt(2.0 / (1.0 + np.cos(latitude) * np.cos(0.5 * longitude)))
    return np.stack(
        [-2.0 * scale * np.cos(latitude) * np.sin(0.5 * longitude), scale * np.sin(latitude)], axis=-1
    )


def _broken(xy):
    """A line with a gap where it leaps from one edge of the map to the other. (n, 2) -> (m, 2)"""
    jumps = np.flatnonzero(np.abs(np.diff(xy[:, 0])) > 2.0) + 1
    return np.insert(xy, jumps, np.nan, axis=0)


def _direction(ra_deg, dec_deg):
    ra, dec = np.broadcast_arrays(np.radians(ra_deg), np.radians(dec_deg))
    return np.stack([np.cos(dec) * np.cos(ra), np.cos(dec) * np.sin(ra), np.sin(dec)], axis=-1)


@style.styled
def sky_map(data):
    """Whole sky and the part the camera looked at. RunData -> Figure; None without frames."""
    sky = around(data)
    if sky is None or not len(data.truth.t_s):
        return None
    figure = style.figure(5.3)
    style.title(figure, "Where the star camera looked: the whole sky, and the part around its path")
    whole = figure.add_axes([0.03, 0.2, 0.6, 0.69])
    near = figure.add_axes([0.69, 0.27, 0.3, 0.56])
    stars = _stars(_FIELD_VMAG)
    _draw_whole(whole, data, sky, stars)
    _draw_near(near, data, sky, stars)
    return figure


def _stars(vmag):
    """Directions (n, 3) and magnitudes (n,)."""
    from shefex_nav.environment import stars

    catalogue = stars.load_catalogue(vmag)
    return catalogue.u_i, catalogue.vmag


def _centre(sky):
    """Mean direction of the frames that gave a fix, of all where none did."""
    chosen = sky.boresight_i[sky.solved] if sky.solved.any() else sky.boresight_i
    middle = np.median(chosen, axis=0)
    return middle / max(float(np.linalg.norm(middle)), 1e-12)


def _draw_whole(axes, data, sky, stars):
    middle_rad = float(np.arctan2(*_centre(sky)[1::-1]))
    axes.set_aspect("equal")
    axes.axis("off")
    outline = np.linspace(0.0, 2.0 * np.pi, 181)
    ellipse = np.column_stack([2.0 * np.sqrt(2.0) * np.cos(outline), np.sqrt(2.0) * np.sin(outline)])
    axes.fill(*ellipse.T, fill=False, edgecolor=style.GREY, lw=0.8, zorder=0)
    axes.set(xlim=(-2.9, 2.9), ylim=(-1.45, 1.45))
    _graticule(axes, middle_rad)
    u_i, vmag = stars
    bright = vmag < _ALL_SKY_VMAG
    axes.scatter(
        *hammer(u_i[bright], middle_rad).T, s=_size(vmag[bright], 4.0), color="#555555", lw=0, rasterized=True
    )
    chosen = sky.t_s[sky.solved] if sky.solved.any() else sky.t_s
    half_s = float(chosen[len(chosen) // 2])
    _exclusion(axes, data, sky, half_s, middle_rad)
    for t_s, dashes in zip((chosen[0], half_s, chosen[-1]), ((0, (1, 1.5)), "-", (0, (5, 2))), strict=True):
        edge = limb(data, float(t_s))
        line = _broken(hammer(limb_line(edge), middle_rad))
        axes.plot(*line.T, color=style.GREEN, lw=1.3, ls=dashes, label=f"Earth's limb, T{edge.t_s:+.0f} s")
    for is_solved, colour, name, size in _PATH:
        chosen = sky.solved == is_solved
        if chosen.any():
            path = hammer(sky.boresight_i[chosen], middle_rad)
            style.dots(axes, *path.T, ms=size, color=colour, label=f"boresight, {name}")
    sun = hammer(sky.sun_i, middle_rad)
    axes.plot(*sun, "o", ms=13, mfc=style.YELLOW, mec=style.BLACK, mew=0.8, ls="none", label="Sun")
    axes.figure.legend(
        *axes.get_legend_handles_labels(), loc="lower left", ncols=3, fontsize=10, borderaxespad=0.8
    )


def _size(vmag, largest):
    """Area of a star's dot in points squared."""
    return np.clip(largest * 10.0 ** (-0.22 * (vmag - 1.0)), 0.4, 3.0 * largest)


def _graticule(axes, middle_rad):
    """Circles of declination and right ascension, the latter named in hours."""
    fine = np.linspace(-180.0, 180.0, 181)
    for dec in (-60, -30, 0, 30, 60):
        line = _broken(hammer(_direction(fine + np.degrees(middle_rad) % 2, dec), middle_rad))
        order = np.argsort(line[:, 0])
        axes.plot(*line[order].T, color="#dddddd", lw=0.6, zorder=0)
        end = hammer(_direction(np.degrees(middle_rad) + 179.9, dec), middle_rad)
        axes.text(end[0] - 0.04, end[1], f"{dec:+d}°", fontsize=9, color=style.GREY, ha="right", va="center")
    for hour in range(0, 24, 3):
        line = _broken(hammer(_direction(15.0 * hour, np.linspace(-90.0, 90.0, 61)), middle_rad))
        axes.plot(*line.T, color="#dddddd", lw=0.6, zorder=0)
        place = hammer(_direction(15.0 * hour, 0.0), middle_rad)
        axes.text(
            *place, f"{hour} h", fontsize=9, ha="center", va="center", zorder=4,  # above the limb
            bbox={"boxstyle": "square,pad=0.1", "facecolor": "white", "edgecolor": "none", "alpha": 0.8},
        )  # fmt: skip


def _exclusion(axes, data, sky, t_s, middle_rad):
    """Shade what the exclusion angles forbid at one instant."""
    sun_limit, limb_limit = sky.limits.sun_exclusion_rad, sky.limits.limb_exclusion_rad
    if sun_limit is None or limb_limit is None:
        return
    edge = limb(data, t_s)
    dec, ra = np.linspace(-89.5, 89.5, _GRID[0]), np.linspace(-179.9, 179.9, _GRID[1])
    u_i = _direction(*np.meshgrid(ra + np.degrees(middle_rad), dec))
    sun_angle = np.arccos(np.clip(u_i @ sky.sun_i, -1.0, 1.0))
    flat_e = u_i.reshape(-1, 3) @ edge.C_ie
    above = np.array([wgs84.limb_angle(edge.r_e, u) for u in flat_e]).reshape(_GRID)
    is_hidden = bool(sky.sun_hidden[np.argmin(np.abs(sky.t_s - t_s))])
    margin = above - limb_limit if is_hidden else np.minimum(sun_angle - sun_limit, above - limb_limit)
    xy = hammer(u_i, middle_rad)
    axes.contourf(xy[..., 0], xy[..., 1], margin, levels=[-10.0, 0.0], colors=["#f3e3d3"], zorder=-1)
    of_sun = "" if is_hidden else f"{np.degrees(sun_limit):.0f}° to the Sun, "
    words = f"excluded at T{edge.t_s:+.0f} s: {of_sun}{np.degrees(limb_limit):.0f}° to the limb"
    label = f"{words}; the Sun is hidden" if is_hidden else words
    axes.fill_between([0.0], [0.0], [0.0], color="#f3e3d3", lw=0, label=label)


def _tangent(u_i, centre):
    """Angles east (to the left) and north of a direction: (..., 3) -> (..., 2) deg, azimuthal equidistant."""
    east = np.cross([0.0, 0.0, 1.0], centre)
    east /= max(float(np.linalg.norm(east)), 1e-12)
    north = np.cross(centre, east)
    across = np.stack([-(u_i @ east), u_i @ north], axis=-1)
    length = np.linalg.norm(across, axis=-1, keepdims=True)
    angle = np.arctan2(length, (u_i @ centre)[..., None])
    return np.degrees(np.divide(angle, length, out=np.ones_like(angle), where=length > 1e-12) * across)


def _draw_near(axes, data, sky, stars):
    centre = _centre(sky)
    chosen = sky.boresight_i[sky.solved] if sky.solved.any() else sky.boresight_i
    far = float(np.quantile(np.arccos(np.clip(chosen @ centre, -1.0, 1.0)), _SHARE))
    camera = data.mission.camera
    half_field = np.hypot(camera.width_px, camera.height_px) / 2.0 / camera.focal_length_px
    reach = np.degrees(np.clip(1.15 * (far + half_field), _LEAST_FIELD, _LARGEST_FIELD))
    u_i, vmag = stars
    inside = u_i @ centre > np.cos(np.radians(1.5 * reach))
    faintest = 6.0 if reach < 15.0 else 5.0
    drawn = inside & (vmag < faintest)
    axes.scatter(
        *_tangent(u_i[drawn], centre).T, s=_size(vmag[drawn], 20.0), color="#666666", lw=0, rasterized=True
    )
    for is_solved, colour, _, size in _PATH:
        those = sky.solved == is_solved
        style.dots(axes, *_tangent(sky.boresight_i[those], centre).T, ms=size, color=colour)
    frame = (
        data.frame_truths[int(np.flatnonzero(sky.solved)[sky.solved.sum() // 2])]
        if sky.solved.any()
        else (data.frame_truths[len(data.frame_truths) // 2])
    )
    corners = _border(data.mission) @ rotation.dcm_from_quat(frame.q_ic).T
    outline = _tangent(corners, centre)
    axes.plot(*outline.T, color=style.BLACK, lw=1.2, label="_field")
    axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    ra_h, dec_deg = (
        np.degrees(np.arctan2(centre[1], centre[0])) % 360.0 / 15.0,
        np.degrees(np.arcsin(centre[2])),
    )
    words = f"around {ra_h:.1f} h, {dec_deg:+.1f}°; stars to V {faintest:.0f}"
    axes.set_title(f"{words};\nfield of view at T{frame.t_valid_s:+.0f} s", fontsize=10)
    axes.set_xlabel("west [deg]")
    axes.set_ylabel("north [deg]")


def _border(mission):
    """Directions of the border of the picture in camera axes, once around: (n, 3)."""
    xy = distortion.border(mission.camera, mission.distortion)
    rays = np.column_stack([xy, np.ones(len(xy))])
    return rays / np.linalg.norm(rays, axis=1, keepdims=True)
