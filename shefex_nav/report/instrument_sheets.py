"""Instruments of the package, for people who choose one: the figures that are compared, and all of one.

Values are shown as the file of the instrument has them, in the units of its data sheet; what follows from
several of them is computed.
"""

import math
from typing import NamedTuple

from shefex_nav.files import text_of

ASSUMED = "[E] assumed"
KINDS = {"imu": "inertial measurement units", "gps": "GPS receivers", "star_camera": "star cameras"}
HEADS = {  # columns of a list, by kind; '>' of numbers
    "imu": ("name", "unit", "grade", ">gyro floor", ">gyro random walk", ">gyro range",
            ">accelerometer bias", ">random walk", ">range"),
    "gps": ("name", "unit", "grade", ">highest rate", ">accuracy", ">range noise", ">range rate noise",
            ">highest speed", ">height"),
    "star_camera": ("name", "unit", "grade", ">pixels", ">field of view", ">f-number", ">magnitude 0",
                    ">faintest in 50 ms"),
}  # fmt: skip
EXPOSURE_S = 0.05  # of the faintest star that is compared
SNR = 5.0  # of it, in 3 x 3 pixels


class Value(NamedTuple):
    """One value of an instrument's file."""

    key: str  # dotted
    value: str  # as written
    assumed: bool
    note: str  # what the file says of it


class Sheet(NamedTuple):
    """An instrument: what its file says, and what that amounts to."""

    name: str
    file: str
    instrument: str  # the section that it is for
    unit: str
    grade: str
    source: str
    values: tuple  # of Value
    computed: dict  # name: words
    compared: dict  # heads of the list: words
    use: str  # line for a scenario

    def as_json(self):
        """Plain values."""
        return {**self._asdict(), "values": [one._asdict() for one in self.values]}


def sheets():
    """Sheet of every instrument of the package, by kind and grade: list."""
    from shefex_nav.scenario import instruments

    kinds = list(KINDS)
    found = [sheet(name) for name in instruments.files()]
    return sorted(found, key=lambda one: (kinds.index(one.instrument), one.grade, one.name))


def sheet(name):
    """Sheet of an instrument of the package; KeyError if there is none of that name."""
    from shefex_nav.scenario import instruments

    return of_file(name, instruments.files()[name])


def of_file(name, path):
    """Sheet of the instrument `name` in a file; ScenarioError, or OSError, if it is none."""
    from shefex_nav.scenario import document, instruments, load

    text = text_of(path)
    try:
        own = document.parse(text, path)
    except document.BadText as error:
        raise load.ScenarioError([f"{error.args[0]}: {error.args[1]}"]) from None
    tree, kind = own.tree, own.tree.get(instruments.KIND)
    if kind not in KINDS:
        words = f"one begins with '{instruments.KIND}: ' and one of {', '.join(KINDS)}"
        raise load.ScenarioError([f"{path}: is no file of an instrument: {words}"])
    loaded, _, _ = load.load_as(lambda provided: instruments.SECTIONS[kind,], path)
    values = tuple(_values(own, text.splitlines()))
    computed, compared = _COMPUTED[kind](_Shown(values), tree, loaded)
    return Sheet(
        name, path, kind, tree["unit"], tree["grade"], tree["source"], values, computed, compared,
        f"{kind}: {{use: {name}}}",
    )  # fmt: skip


class _Shown(dict):
    """{key: value as a list shows it, with a star if it is assumed}."""

    def __init__(self, values):
        super().__init__({one.key: f"{one.value}*" if one.assumed else one.value for one in values})


def _values(own, lines):
    """Value of each single value of a Document, but for those that name the unit."""
    from shefex_nav.scenario.instruments import InstrumentFile

    head = {"instrument", *InstrumentFile.keys()}
    for path, mark in own.values.items():
        value = own.tree
        for part in path:
            value = value[part]
        in_list = any(isinstance(part, int) for part in path)  # which is shown whole
        if not path or path[0] in head or in_list or isinstance(value, dict):
            continue
        said = lines[mark.line - 1].partition(" # ")[2]
        assumed = ASSUMED in said
        note = said.replace(f"; {ASSUMED}", "").replace(ASSUMED, "").removeprefix(":").strip()
        yield Value(".".join(path), str(value), assumed, note)


def _imu(shown, tree, loaded):
    from shefex_nav.world import allan

    computed = {}
    for triad, said in (("gyro", loaded.gyro), ("accelerometer", loaded.accelerometer)):
        lowest, at_s = allan.floor(said)
        computed[f"{triad}: lowest Allan deviation as simulated"] = (
            f"{_written(said, lowest)} at {at_s:.3g} s"
        )
    own = f"{_written(loaded.gyro, allan.floor(loaded.gyro)[0])}*"  # no data sheet says so
    keys = "gyro.random_walk", "gyro.range", "accelerometer.bias", "accelerometer.random_walk"
    rows = shown.get("floor.gyro", own), *(shown[key] for key in (*keys, "accelerometer.range"))
    return computed, _compared("imu", rows)


def _written(triad, bias):
    """A bias of a triad in the unit of people."""
    from shefex_nav.scenario.quantity import QuantitySpec

    field = type(triad).model_fields["in_run_bias"]
    spec = next(one for one in field.metadata if isinstance(one, QuantitySpec))
    number, _, unit = spec.write(bias).partition(" ")
    return f"{float(number):.3g} {unit}"


def _gps(shown, tree, loaded):
    accuracy = f"{shown['accuracy.position']} {shown['accuracy.position_is']}" if "accuracy" in tree else ""
    keys = "range_noise", "range_rate_noise", "highest_speed", "highest_height"
    return {}, _compared("gps", (shown["highest_rate"], accuracy, *(shown[key] for key in keys)))


def _star_camera(shown, tree, loaded):
    from shefex_nav.scenario import lens, starlight

    optics, detector = loaded.optics, loaded.detector
    light = starlight.of_camera(tree)
    flux = optics.zero_magnitude_flux or light.flux
    view = "{:.1f} x {:.1f} deg".format(*lens.field_of_view_deg(loaded)[:2])
    faintest = f"{faintest_magnitude(flux, optics, detector):.1f} mag"
    computed = {
        "field of view": view,
        "faintest star": f"{faintest} with a signal {SNR:g} times its noise in 3 x 3 pixels, 50 ms",
    }
    if light is not None:
        computed["star of magnitude 0"] = light.words()
    number = optics.focal_length / light.aperture if light else math.nan
    rows = (
        f"{detector.columns} x {detector.rows}",
        view,
        f"{number:.3g}",
        f"{flux:.3g} electron/s",
        faintest,
    )
    return computed, _compared("star_camera", rows)


_COMPUTED = {"imu": _imu, "gps": _gps, "star_camera": _star_camera}


def _compared(kind, rows):
    """{head of the list: words} of what stands behind name, unit and grade."""
    return dict(zip((head.removeprefix(">") for head in HEADS[kind][3:]), map(str, rows), strict=True))


def faintest_magnitude(flux, optics, detector):
    """Magnitude of a star at rest with a signal SNR times its noise in 3 x 3 pixels within EXPOSURE_S.

    Light on the middle of a pixel; noise of its own charge, of the background and of reading out.
    """
    share = math.erf(1.5 / (math.sqrt(2.0) * optics.psf_sigma)) ** 2
    quiet = 9.0 * (detector.background * EXPOSURE_S + detector.read_noise**2)  # variance without the star
    charge = 0.5 * (SNR**2 + math.sqrt(SNR**4 + 4.0 * SNR**2 * quiet))
    return -2.5 * math.log10(charge / (share * EXPOSURE_S * flux))
