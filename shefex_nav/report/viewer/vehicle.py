"""The vehicle in the scene: its shape, what the camera must not see, the satellites that it hears.

Nothing but directions is true to scale: a rocket of twelve metres in a scene of 800 km would be invisible.
"""

import math

import numpy as np

from shefex_nav.geometry import wgs84
from shefex_nav.geometry.frames import dcm_ie
from shefex_nav.geometry.rotation import quat_from_dcm, xyzw
from shefex_nav.report.viewer.sender import GREY, YELLOW

LENGTH = 0.06  # of the drawn rocket, by the size of the scene
BEAM = 0.12  # of the drawn cones and lines of sight likewise
LEVEL = "vehicle"  # frame at the vehicle with inertial axes
POSE_S = 0.5  # between two places of that frame
SIDES = 16
CONES = 300  # places at which the cone about the Earth is drawn anew, at least; it turns by the arc flown
SATELLITE = (110, 200, 255)
SUN_ENTITY, EARTH_ENTITY = "world/cones/sun", "world/cones/earth"


def send(sender, data, places, size):
    """Everything of one run.

    places : (t_s (n,), launch-axes positions (n, 3) m) of the vehicle;  size : of the scene [m]
    """
    rocket(sender, size)
    follow(sender, data, *places)
    cones(sender, data, *places, size)
    satellites(sender, data, *places, size)


def rocket(sender, size):
    """A body of revolution with four fins along x, in body axes."""
    import rerun as rr

    vertices, triangles = rocket_mesh(LENGTH * size)
    mesh = rr.Mesh3D(vertex_positions=vertices, triangle_indices=triangles, albedo_factor=[235, 235, 240])
    sender.static("world/vehicle", mesh, rr.CoordinateFrame("body"))


def rocket_mesh(length):
    """Vertices (n, 3) m and triangles (m, 3) of a rocket, its middle at the origin, its nose along x."""
    radius, shoulder = 0.045 * length, 0.25 * length
    turn = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = np.column_stack([np.zeros(SIDES), np.cos(turn), np.sin(turn)]) * radius
    x = np.array([1.0, 0.0, 0.0])
    vertices = [*(ring - 0.5 * length * x), *(ring + shoulder * x), 0.5 * length * x, -0.5 * length * x]
    nose, tail = 2 * SIDES, 2 * SIDES + 1
    triangles = []
    for k in range(SIDES):
        after = (k + 1) % SIDES
        a, b, c, d = k, after, SIDES + k, SIDES + after
        triangles += [(a, b, c), (b, d, c), (c, d, nose), (b, a, tail)]
    for angle in 0.25 * np.pi + 0.5 * np.pi * np.arange(4):
        out = np.array([0.0, np.cos(angle), np.sin(angle)])
        n = len(vertices)
        vertices += [radius * out - 0.28 * length * x, -0.5 * length * x + radius * out]
        vertices += [3.2 * radius * out - 0.5 * length * x]
        triangles += [(n, n + 1, n + 2), (n, n + 2, n + 1)]  # seen from both sides
    return np.array(vertices), np.array(triangles)


def follow(sender, data, t_s, r_l):
    """The frame LEVEL: at the vehicle, with inertial axes, which turn in those of the launch site."""
    import rerun as rr

    C_le = wgs84.dcm_el(data.mission.launch_latitude, data.mission.launch_longitude).T
    q_li = [xyzw(quat_from_dcm(C_le @ dcm_ie(data.mission.earth, t).T)) for t in t_s]
    columns = rr.Transform3D.columns(
        translation=r_l,
        quaternion=q_li,
        parent_frame=["launch"] * len(t_s),
        child_frame=[LEVEL] * len(t_s),
    )
    start_s = data.mission.start_s
    times = np.where(t_s < start_s + POSE_S, start_s, t_s)  # there from the start on
    sender.columns("world/level", times, columns)


def cones(sender, data, t_s, r_l, size):
    """Cones about the Sun and about the Earth that the camera must keep out of, as lines."""
    import rerun as rr

    mission = data.mission
    if not np.isfinite(mission.sun_exclusion):
        return  # a log of before they were in it, or external data
    frame = rr.CoordinateFrame(LEVEL)
    lines = cone_lines(mission.sun_i, mission.sun_exclusion, BEAM * size)
    sender.static(SUN_ENTITY, rr.LineStrips3D(lines, colors=[YELLOW], radii=[-0.6]), frame)
    t_s = t_s[:: max(1, len(t_s) // CONES)]
    k = np.searchsorted(data.truth.t_s, t_s).clip(0, len(data.truth.t_s) - 1)
    r_i = data.truth.r_i[k]
    height = np.linalg.norm(r_i, axis=1)
    limb = np.arcsin(np.minimum(wgs84.A / height, 1.0))  # from nadir
    half = limb + mission.limb_exclusion
    strips = [cone_lines(-r / h, a, BEAM * size) for r, h, a in zip(r_i, height, half, strict=True)]
    style = rr.LineStrips3D.from_fields(colors=[(90, 140, 190)], radii=[-0.5])
    sender.static(EARTH_ENTITY, style, frame)
    columns = rr.LineStrips3D.columns(strips=[line for lines in strips for line in lines])
    sender.columns(EARTH_ENTITY, t_s, columns.partition([len(lines) for lines in strips]))


def cone_lines(axis, half_angle, length):
    """A ring and eight lines of a cone with its tip at the origin: list of (n, 3)."""
    z = np.asarray(axis) / np.linalg.norm(axis)
    x = wgs84.perpendicular(z)
    y = np.cross(z, x)
    turn = np.linspace(0.0, 2.0 * math.pi, 4 * SIDES + 1)
    across = np.outer(np.cos(turn), x) + np.outer(np.sin(turn), y)
    ring = length * (math.cos(half_angle) * z + math.sin(half_angle) * across)
    return [ring, *(np.array([np.zeros(3), point]) for point in ring[:-1:8])]


def satellites(sender, data, t_s, r_l, size):
    """Lines towards the satellites whose ranges are measured; a log without ranges has none."""
    import rerun as rr

    heard = [ranges for ranges in data.gps_ranges if len(ranges.prn)]
    if not heard:
        return
    site = data.mission.launch_latitude, data.mission.launch_longitude
    C_el, origin_e = wgs84.dcm_el(*site), wgs84.ecef_from_geodetic(*site, data.mission.launch_height)
    lines, names, ends = [], [], []
    for ranges in heard:
        here = r_l[np.argmin(np.abs(t_s - ranges.t_valid_s))]
        away = (ranges.r_es_e - origin_e) @ C_el - here
        there = here + BEAM * size * away / np.linalg.norm(away, axis=1, keepdims=True)
        lines += [np.array([here, end]) for end in there]
        ends.append(there)
        names += [f"G{prn:02d}" for prn in ranges.prn]
    counts, times = [len(ranges.prn) for ranges in heard], [ranges.t_valid_s for ranges in heard]
    frame = rr.CoordinateFrame("launch")
    sender.static("world/satellites", rr.LineStrips3D.from_fields(colors=[SATELLITE], radii=[-0.8]), frame)
    sender.columns("world/satellites", times, rr.LineStrips3D.columns(strips=lines).partition(counts))
    style = rr.Points3D.from_fields(colors=[GREY], radii=[-3.0], show_labels=False)  # on pointing at it
    sender.static("world/satellite_names", style, frame)
    columns = rr.Points3D.columns(positions=np.concatenate(ends), labels=names)
    sender.columns("world/satellite_names", times, columns.partition(counts))
