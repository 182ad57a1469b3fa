"""A section of the flight made ready for the kernels: one record of numbers, one flat array of tables, and
where a value lies in an ascending column of one of these.

In: `vehicle.Configuration`, `surroundings.World`. Out: `Scene`.

The derivative of the state is evaluated some 10^5 times per flight and takes half a microsecond. Handing down
two dozen arrays through its functions, each counted as in use and as no longer in use, would take three times
as long; a record is handed down as one address.
"""

from typing import NamedTuple

import numpy as np

from shefex_nav.compiled import inner, kernel, rows

_SCALARS = (
    "angle_0", "rate",  # of the Earth, rad at t = 0, rad/s
    "gm", "radius", "j2",  # of the closed form of gravitation
    "a", "e2",  # of the ellipsoid
    "density_factor", "rail_length",
    "exhaust_speed", "exit_area", "exit_station", "gas",
    "area", "diameter", "fin_cant", "moment_station",
)  # fmt: skip
_VECTORS = {
    "C_iq": (3, 3), "C_re": (3, 3), "rail_r_e": 3, "rail_direction_e": 3,
    "products": 3, "offset": 2, "thrust_axis": 3, "thrust_offset": 2, "imu": 3, "yo_yo": 4, "parachute": 5,
    "torque": 3,  # N m, body axes, of the attitude control; zero where it does not act
    "C": (3, 3),  # to work in: C_ib of the state that is looked at
}  # fmt: skip
# where a table begins in the flat array, and how many rows it has
_TABLES = ("mass", "thrust", "mach", "alpha", "aero", "damping", "spin_motors", "air", "wind", "wind_times")

RECORD = rows(
    [(name, np.float64) for name in _SCALARS]
    + [(name, np.float64, shape) for name, shape in _VECTORS.items()]
    + [(f"{name}_{what}", np.int64) for name in _TABLES for what in ("at", "n")]
    + [(name, np.int64) for name in ("thrust_row", "mass_row")],  # see vehicle.choose_rows
    align=True,
)


class Scene(NamedTuple):
    """What the kernels see of vehicle and surroundings. Fields: as in Configuration, AeroTables and World."""

    record: np.ndarray  # (1,) of RECORD
    tables: np.ndarray  # (n,) all tables, row by row; aero: C_A, C_N, C_M, C_D for each Mach number and angle


def prepare(configuration, world):
    """Scene of one section, which nothing steers yet."""
    c, aero = configuration, configuration.aero
    record = np.zeros(1, dtype=RECORD)
    groups = (c._asdict(), aero._asdict(), world._asdict(), world.earth._asdict())
    known = {name: value for group in groups for name, value in group.items()}
    known |= {f"rail_{name}": value for name, value in world.rail._asdict().items()}
    known |= dict(zip(("gm", "radius", "j2"), world.coarse, strict=True))
    known |= dict(zip(("a", "e2"), world.shape, strict=True))
    known |= {"torque": 0.0, "C": 0.0}
    for name in (*_SCALARS, *_VECTORS):
        record[name] = known[name]
    known["aero"] = np.stack([aero.axial, aero.normal, aero.moment, aero.drag], axis=-1)
    at, parts = 0, []
    for name in _TABLES:
        table = np.asarray(known[name], dtype=float)
        if name == "wind" and len(table) == 1:  # the same at all heights
            table = np.vstack([table, table])
            table[1, 0] += 1.0
        record[f"{name}_at"], record[f"{name}_n"] = at, len(table)
        parts.append(table.ravel())
        at += table.size
    return Scene(record, np.concatenate(parts))


@kernel(error_model="numpy", forceinline=True)
def place(tables, at, n, step, x):
    """(k, part): x lies part of the way from value k to value k + 1; 0 or 1 beyond the ends.

    The n >= 2 ascending values are tables[at], tables[at + step] and so on.
    """
    low, high = 0, n - 1
    if x <= tables[at]:
        return 0, 0.0
    if x >= tables[at + step * high]:
        return high - 1, 1.0
    while high - low > 1:
        middle = (low + high) // 2
        if x < tables[at + step * middle]:
            high = middle
        else:
            low = middle
    below = tables[at + step * low]
    return low, (x - below) / (tables[at + step * high] - below)


@inner(error_model="numpy", forceinline=True)
def mixed(tables, at, step, part):
    """Value part of the way from tables[at] to tables[at + step]."""
    return tables[at] + part * (tables[at + step] - tables[at])
