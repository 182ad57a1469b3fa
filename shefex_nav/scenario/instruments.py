"""Instruments in files of their own, for sections that `use` them: what such a file holds, and where it is.

A file says for which section it is (`instrument`), which unit it describes and from where its values are, and
may give figures as its data sheet has them from which values follow; the rest are keys of that section. A
name means a file as the name of a scenario does (`shipped`); those that come with the package are in
`scenarios/data/instruments`.
"""

import os
from typing import Literal, NamedTuple

from pydantic import Field, create_model

from shefex_nav.scenario import shipped
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.files import Unreadable
from shefex_nav.scenario.quantity import Quantity
from shefex_nav.scenario.sensors import Accelerometer, Gps, Gyro, Imu, StarCamera

KIND = "instrument"  # key that says for which section a file is


class InstrumentFile(Block):
    """What every file of an instrument says of itself."""

    unit: str = Field(min_length=1, description="maker and type of the unit")
    grade: str = Field(min_length=1, description="class of such units, such as 'tactical'")
    source: str = Field(min_length=1, description="data sheet, or who has measured the values")


class Floor(Block):
    """Lowest Allan deviations of the data sheet, there called bias instability or in-run bias stability.

    `in_run_bias` and its time are what the sensor has to have, beside its random walk, to come down to these.
    """

    gyro: Quantity("rad/s", "2.3 deg/h", "of the gyros", positive=True) | None = None
    accelerometer: Quantity("m/s2", "3.6 ugee", "of the accelerometers", positive=True) | None = None


class ImuFile(InstrumentFile):
    """File of an inertial measurement unit; what shakes it is the vehicle's and stays in the scenario."""

    instrument: Literal["imu"]
    floor: Floor = Field(default_factory=Floor)
    gyro: Gyro
    accelerometer: Accelerometer


class Accuracy(Block):
    """What a data sheet says of the fixes of a receiver on the ground with many satellites in view.

    Errors north and east are taken as normal, of one sigma, with the HDOP 1 [E] that goes with such a sky. So
    the range noise is sqrt(2) sigma, with a sigma of CEP/1.1774 (half of all errors within the circle),
    2DRMS/2.8284, RMS/1.4142 (of both) or 1SIGMA itself; likewise the noise of the range rate.
    """

    position: Quantity("m", "1.5 m", "horizontal", positive=True, at_most="10000 km")
    position_is: Literal["CEP", "2DRMS", "RMS", "1SIGMA"]
    velocity: Quantity("m/s", "0.05 m/s", "horizontal", positive=True) | None = None
    velocity_is: Literal["CEP", "2DRMS", "RMS", "1SIGMA"] | None = None


class GpsFile(InstrumentFile):
    """File of a GPS receiver; antenna, spin, outages and what the sky does stay in the scenario."""

    instrument: Literal["gps"]
    highest_rate: Quantity("Hz", "10 Hz", "of fixes that the receiver can give", positive=True)
    accuracy: Accuracy | None = None


class CameraFile(InstrumentFile):
    """File of a star camera: sensor and lens; mounting, sky, defects and baffle stay in the scenario."""

    instrument: Literal["star_camera"]


def _with(file, model, *names):
    """A file's model with fields of a section."""
    fields = {name: (model.model_fields[name].annotation, model.model_fields[name]) for name in names}
    return create_model(file.__name__, __base__=file, __module__=__name__, __doc__=file.__doc__, **fields)


GpsFile = _with(
    GpsFile, Gps, "rate", "latency", "range_noise", "range_rate_noise", "highest_speed", "highest_height",
    "clock", "reacquisition",
)  # fmt: skip
CameraFile = _with(CameraFile, StarCamera, "optics", "detector")
SECTIONS = {  # path of the section: what a file for it holds
    ("imu",): ImuFile,
    ("navigation", "told", "imu"): ImuFile,
    ("gps",): GpsFile,
    ("star_camera",): CameraFile,
}
OF_SECTION = {"imu": Imu, "gps": Gps, "star_camera": StarCamera}


def values_of(section):
    """Keys of a file for a section that are values of the section: list."""
    return [key for key in SECTIONS[section].keys() if key in OF_SECTION[section[-1]].keys()]


class Shipped(NamedTuple):
    """An instrument of the package."""

    name: str
    file: str
    instrument: str  # the section that it is for
    grade: str
    unit: str


def folder():
    """Where those of the package are."""
    return os.path.join(shipped.folder(), "data", "instruments")


def files():
    """{name: path} of those of the package."""
    place = folder()
    names = sorted(os.listdir(place)) if os.path.isdir(place) else ()
    return {
        one.removesuffix(shipped.ENDING): os.path.join(place, one)
        for one in names
        if one.endswith(shipped.ENDING)
    }


def listed():
    """list of Shipped."""
    from shefex_nav.scenario import document

    found = []
    for name, path in files().items():
        with open(path, encoding="utf-8") as stream:
            tree = document.parse(stream.read(), path).tree
        found.append(Shipped(name, path, tree[KIND], tree["grade"], tree["unit"]))
    return found


def resolved(section, name, beside):
    """Path of the file that `name` means for a section, beside the scenario or of the package; Unreadable."""
    if (found := shipped.found(name, beside, files())) is not None:
        return found
    where = f" in {beside}" if beside else ""
    stem = name.removesuffix(shipped.ENDING)
    raise Unreadable(f"there is no file '{name}'{where}, and {unknown(section, stem)}")


def unknown(section, name):
    """Words about a name that no instrument of the package has."""
    of_class = [one.name for one in _for(section) if name.lower() in one.grade.lower()]
    alike = of_class or shipped.alike(name, [one.name for one in _for(section)])
    more = f"did you mean {' or '.join(alike)}?" if alike else listing(section)
    return f"no instrument '{name}' comes with the program (in {folder()}); {more}"


def listing(section):
    """Words about what the package has for a section."""
    words = ", ".join(f"{one.name} ({one.grade})" for one in _for(section))
    return f"there are {words}" if words else "there are none"


def _for(section):
    """Those of the package for a section."""
    return [one for one in listed() if one.instrument == section[-1]]


def instead(section, tree):
    """What a tree is if it is no instrument for the section; '' if it is, or means to be."""
    made_for = tree.get(KIND)
    if made_for is None:
        return f"is no file of an instrument: one for this section begins with '{KIND}: {section[-1]}'"
    if made_for != section[-1]:
        return f"is an instrument for the section {made_for}, not for {section[-1]}"
    return ""
