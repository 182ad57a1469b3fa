"""`navigation.told`: figures of the sensors that the computer on board is told in place of the true ones.

The sections of the sensors say what they are; what the computer knows of them is taken from there. Values in
`navigation.told`, under the same keys and in the same units, take their place for the computer alone. The
world never sees them.
"""

from typing import Annotated, ClassVar, get_args

from pydantic import Field, create_model

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.document import dotted, placed
from shefex_nav.scenario.messages import bare, field_at, is_model
from shefex_nav.scenario.quantity import QuantitySpec
from shefex_nav.scenario.sensors import Gps, Imu, StarCamera

# What the computer takes from the section of the receiver and of the camera; the rest is the world's alone.
OF_GPS = {
    **dict.fromkeys(("latency", "clock_offset", "range_noise", "range_rate_noise", "clock", "errors")),
    "antenna": {"lever_arm": None},
}
OF_OPTICS = (
    "focal_length",
    "focal_length_error",
    "principal_point",
    "principal_point_error",
    "distortion",
    "psf_sigma",
    "zero_magnitude_flux",
)
OF_CAMERA = {"mounting": None, "optics": dict.fromkeys(OF_OPTICS)}
SAME = {  # keys of `navigation.sensors`: what they say too
    "gyro_bias": ("imu", "gyro", "bias"),
    "gyro_random_walk": ("imu", "gyro", "random_walk"),
    "gyro_scale_factor_roll": ("imu", "gyro", "scale_factor_roll"),
    "gyro_misalignment": ("imu", "gyro", "misalignment"),
    "accelerometer_bias": ("imu", "accelerometer", "bias"),
    "accelerometer_random_walk": ("imu", "accelerometer", "random_walk"),
    "camera_mounting": ("star_camera", "mounting", "error"),
    "lever_arm": ("gps", "antenna", "lever_arm"),
    "clock_bias": ("gps", "clock", "bias"),
    "clock_drift": ("gps", "clock", "drift"),
    "clock_white_frequency": ("gps", "clock", "h_0"),
    "clock_random_walk": ("gps", "clock", "h_minus_2"),
    "range_bias": ("gps", "errors"),
}


def part_of(model, keys=None):
    """A model with keys of another, none of which need be given.

    A section that may be left out there must be whole where it is given here.

    keys : {key: keys of its section or None for all}; None: all of the model
    """
    fields = {}
    for name, field in model.model_fields.items():
        key = field.alias or name
        if keys is not None and key not in keys:
            continue
        annotation, metadata = bare(field.annotation, tuple(field.metadata))
        if is_model(annotation) and type(None) not in get_args(field.annotation):
            annotation = part_of(annotation, None if keys is None else keys[key])
        words = field.description or (annotation.__doc__ if is_model(annotation) else None)
        full = Annotated[annotation, *metadata] if metadata else annotation
        fields[name] = (full | None, Field(default=None, alias=field.alias, description=words))
    return create_model(f"Told{model.__name__}", __base__=Block, __doc__=model.__doc__, **fields)


class Told(Block):
    """Figures of the sensors that the computer on board is told where they are not the true ones."""

    NAME: ClassVar[str] = "Told"
    HELP: ClassVar[str] = "figures of the sensors that the computer is told in the place of the true ones"

    imu: part_of(Imu) | None = Field(None, description="of the IMU and of what shakes it")
    gps: part_of(Gps, OF_GPS) | None = Field(None, description="of the GPS receiver and its antenna")
    star_camera: part_of(StarCamera, OF_CAMERA) | None = Field(None, description="of the star camera")


def as_told(scenario):
    """The Scenario that the computer on board takes for the true one: the same if it is told nothing else."""
    told = scenario.navigation.told
    sections = {
        name: over(getattr(scenario, name), given)
        for name in type(told).model_fields
        if (given := getattr(told, name)) is not None and getattr(scenario, name) is not None
    }
    return scenario.with_sections(**sections) if sections else scenario


def over(section, given):
    """A section with the values that are given. Block, one of `part_of` -> Block"""
    values = {}
    for name in type(given).model_fields:
        value = getattr(given, name)
        if value is not None:
            old = getattr(section, name)
            values[name] = (
                over(old, value) if isinstance(old, Block) and type(value) is not type(old) else value
            )
    return section.model_copy(update=values)


def lines(scenario):
    """`FILE:LINE:COL: navigation.told.imu.gyro.bias: 3 deg/h, the truth is 1 deg/h` of each that differs."""
    for field, text in words(scenario):
        yield placed(scenario.place(field), f"{dotted(field)}: {text}")


def words(scenario):
    """(path of the field, `3 deg/h, the truth is 1 deg/h`) of each that differs."""
    for path, true, value in differences(scenario):
        annotation, metadata = field_at(type(scenario), path)
        told, is_so = (_written(annotation, metadata, one) for one in (value, true))
        yield ("navigation", "told", *path), f"{told}, the truth is {is_so}"
    if gone := getattr(scenario, "without", ()):  # which a replay does not have
        it = "it" if len(gone) == 1 else "them"
        yield ("without",), f"{', '.join(gone)}: the computer counts with {it}, the truth is none"


def _written(annotation, metadata, value):
    """A value as one writes it."""
    spec = next((one for one in metadata if isinstance(one, QuantitySpec)), None)
    if isinstance(value, tuple | list):
        inner = bare(get_args(annotation)[0])
        return f"[{', '.join(_written(*inner, one) for one in value)}]"
    if isinstance(value, Block):
        return "other values"
    return "not given" if value is None else str(value) if spec is None else spec.write(value)


def differences(scenario):
    """What the computer is told and is not true: yields (path below `navigation.told`, true value, told)."""
    told = scenario.navigation.told
    for name in type(told).model_fields:
        given, true = getattr(told, name), getattr(scenario, name)
        if given is not None and true is not None:
            yield from _differences(true, given, (name,))


def _differences(section, given, path):
    for key, field in type(given).keys().items():
        name = next(one for one, known in type(given).model_fields.items() if known is field)
        true, value = getattr(section, name), getattr(given, name)
        if isinstance(value, Block) and isinstance(true, Block) and type(value) is not type(true):
            yield from _differences(true, value, (*path, key))
        elif value is not None and value != true:
            yield (*path, key), true, value


def contradictions(scenario):
    """(path of the field, text for people) of what is told twice, or does not go with the rest."""
    told, sensors = scenario.navigation.told, scenario.navigation.sensors
    if _given(told, ("gps", "latency")) and _given(told, ("gps", "clock_offset")):
        words = (
            "is of no use beside latency: the computer counts back from the arrival then, without the stamp"
        )
        yield ("navigation", "told", "gps", "clock_offset"), words
    for key, path in SAME.items():
        if getattr(sensors, key) is not None and _given(told, path):
            words = f"navigation.sensors.{key} says so too; keep one of them"
            yield ("navigation", "told", *path), words


def _given(node, path):
    """Whether something is given at a path."""
    for name in path:
        node = None if node is None else getattr(node, name)
    return node is not None
