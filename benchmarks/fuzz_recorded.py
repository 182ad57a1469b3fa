"""The example of recorded data, spoilt, as CSV, text files of KF-GINS and Matlab files of NaveGo."""

import copy
import io

import mutations
import numpy as np

DT_S, DEG, G = 0.005, np.pi / 180.0, 9.80665
FORWARD_RIGHT_DOWN = np.array([1.0, -1.0, -1.0])  # of axes whose y points left and z up
ARM_M = np.array([0.6, 0.05, -0.03])
WEEK = 2000
ODD = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e9, 1e15, 1e100, 1e308, -1e308, 1e-308)
RAW = 3  # one of so many Matlab files has spoilt bytes, not spoilt arrays
TABLES = "imu", "gnss", "truth"


class Example:
    """The example of the package. tree : its description;  folder : of its tables"""

    def __init__(self, tree, folder):
        self.tree = tree
        self.texts = {path.name: path.read_text() for path in folder.iterdir() if path.suffix == ".csv"}
        self.arrays = _arrays(
            *(np.loadtxt(folder / f"{name}.csv", delimiter=",", skiprows=1) for name in TABLES)
        )
        self.kf_gins_texts = _kf_gins(self.arrays)

    def csv(self, rng):
        """A description and the files beside it, one of all spoilt: tree, {name: bytes}."""
        tree, files = self._spoilt(rng, self.tree, self.texts)
        return tree, {f"{self.tree['data']['folder']}/{name}": text.encode() for name, text in files.items()}

    def kf_gins(self, rng):
        """As `csv`, of the text files of KF-GINS."""
        tree = _described(self.tree, "kf_gins", "txt")
        commas = {name: text.replace(" ", ",") for name, text in self.kf_gins_texts.items()}
        tree, files = self._spoilt(rng, tree, commas)
        return tree, {name: text.replace(",", " ").encode() for name, text in files.items()}

    def matlab(self, rng):
        """As `csv`, of the Matlab files of NaveGo: arrays that are odd, or bytes that are spoilt."""
        tree = _described(self.tree, "navego", "mat")
        is_raw = rng.integers(RAW) == 0
        structures = self.arrays if is_raw else _odd_arrays(rng, self.arrays)
        packed = bool(rng.integers(2))
        files = {f"{name}.mat": _mat(name, one, packed) for name, one in structures.items()}
        if is_raw:
            name = sorted(files)[rng.integers(len(files))]
            files[name] = mutations.data(rng, files[name])
        return tree, files

    def _spoilt(self, rng, tree, texts):
        if rng.integers(3):
            name = sorted(texts)[rng.integers(len(texts))]
            return tree, texts | {name: mutations.table(rng, texts[name])}
        return mutations.tree(rng, tree), texts


def _arrays(imu, gnss, truth):
    """The tables of the example in the names, axes and units of NaveGo."""
    gnss = gnss[gnss[:, 13] > 0.0]
    return {
        "imu": {
            "t": imu[:, 0] / 1e3,
            "wb": imu[:, 1:4] * DEG * FORWARD_RIGHT_DOWN,
            "fb": imu[:, 4:7] * G * FORWARD_RIGHT_DOWN,
        },
        "gnss": _path(gnss) | {"stdm": gnss[0, 7:10], "stdv": gnss[0, 10:13], "larm": ARM_M},
        "truth": _path(truth) | dict(zip(("roll", "pitch", "yaw"), truth[:, 7:10].T * DEG, strict=True)),
    }  # fmt: skip


def _path(table):
    """Times, places and velocities north, east, down of a table: ms, deg, deg, m, m/s east, north, up."""
    return {
        "t": table[:, 0] / 1e3,
        "lat": table[:, 1] * DEG,
        "lon": table[:, 2] * DEG,
        "h": table[:, 3],
        "vel": np.column_stack([table[:, 5], table[:, 4], -table[:, 6]]),
    }


def _kf_gins(arrays):
    """Texts of KF-GINS: increments, degrees, sigmas of each fix, GPS weeks. arrays : of `_arrays`"""
    imu, gnss, truth = (arrays[name] for name in TABLES)
    fixes, weeks = np.ones((len(gnss["t"]), 1)), np.full(len(truth["t"]), WEEK)
    angles = [truth[name] / DEG for name in ("roll", "pitch", "yaw")]
    tables = {
        "imu": [imu["t"], imu["wb"] * DT_S, imu["fb"] * DT_S],
        "gnss": [*_degrees(gnss), fixes * gnss["stdm"], fixes * gnss["stdv"]],
        "truth": [weeks, *_degrees(truth), *angles],
    }
    rows = {name: np.column_stack(columns).tolist() for name, columns in tables.items()}
    return {
        f"{name}.txt": "".join(" ".join(f"{x:.12g}" for x in row) + "\n" for row in table)
        for name, table in rows.items()
    }


def _degrees(path):
    return path["t"], path["lat"] / DEG, path["lon"] / DEG, path["h"], path["vel"]


def _described(tree, form, ending):
    """The description of the example in another format, its files beside it."""
    tree = copy.deepcopy(tree)
    tree["data"] = {
        "format": form,
        "folder": ".",
        "longest_gap": "0.1 s",
        **{name: f"{name}.{ending}" for name in TABLES},
    }
    if form == "navego":
        tree["data"]["samples"] = "mean"
    return tree


def _mat(name, structure, packed):
    """Bytes of a Matlab file with one structure."""
    from scipy.io import savemat

    file = io.BytesIO()
    savemat(file, {name: structure}, do_compression=packed)
    return file.getvalue()


def _odd_arrays(rng, structures):
    """Structures with one or two arrays that are odd, or missing."""
    structures = {name: dict(one) for name, one in structures.items()}
    for _ in range(1 + rng.integers(2)):
        structure = structures[TABLES[rng.integers(len(TABLES))]]
        left = sorted(name for name, values in structure.items() if _is_array(values))
        field = left[rng.integers(len(left))]
        way = rng.integers(10)
        if way == 0:
            del structure[field]
        else:
            structure[field] = _odd(rng, structure[field].copy(), way)
    return structures


def _is_array(values):
    """Whether values are as they were, or still numbers in an array."""
    return isinstance(values, np.ndarray) and values.dtype == float and values.size > 0


def _odd(rng, values, way):
    """Values in a way that no recorder would write. way : 1 to 9"""
    odd = ODD[rng.integers(len(ODD))]
    if way < 4:
        values.reshape(-1)[rng.integers(values.size)] = odd
        return values
    kinds = (
        values + 1j,
        "text",
        np.array(["a", "b"], dtype=object),
        {"a": 1},
        np.zeros((2, 2, 2)),
        np.zeros(0),
    )
    with np.errstate(all="ignore"):
        return {
            4: lambda: np.full_like(values, odd),
            5: lambda: values[: rng.integers(len(values))],
            6: lambda: values[::-1],
            7: lambda: values.T.copy(),
            8: lambda: values * odd,
            9: lambda: (*kinds, values > 0.0, np.repeat(values, 2, axis=0))[rng.integers(len(kinds) + 2)],
        }[way]()
