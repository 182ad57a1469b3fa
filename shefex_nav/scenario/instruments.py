"""Instruments in files of their own, for sections that `use` them: what such a file holds, and where it is.

A file says for which section it is (`instrument`), which unit it describes and from where its values are; the
rest are keys of that section. A name means a file as the name of a scenario does (`shipped`); those that come
with the package are in `scenarios/data/instruments`.
"""

import os
from typing import Literal, NamedTuple

from pydantic import Field

from shefex_nav.scenario import shipped
from shefex_nav.scenario.block import Block
from shefex_nav.scenario.files import Unreadable
from shefex_nav.scenario.sensors import Accelerometer, Gyro

KIND = "instrument"  # key that says for which section a file is


class InstrumentFile(Block):
    """What every file of an instrument says of itself."""

    unit: str = Field(min_length=1, description="maker and type of the unit")
    grade: str = Field(min_length=1, description="class of such units, such as 'tactical'")
    source: str = Field(min_length=1, description="data sheet, or who has measured the values")


class ImuFile(InstrumentFile):
    """File of an inertial measurement unit; what shakes it is the vehicle's and stays in the scenario."""

    instrument: Literal["imu"]
    gyro: Gyro
    accelerometer: Accelerometer


SECTIONS = {  # path of the section: what a file for it holds
    ("imu",): ImuFile,
    ("navigation", "told", "imu"): ImuFile,
}
HEAD = (KIND, *InstrumentFile.keys())  # keys of a file that are no values of the section


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
