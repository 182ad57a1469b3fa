"""Section of a scenario that a file gives: the fitted star tracker of `frames: statistical`.

`shefex-nav characterise` writes the file. `settings` are those of the star camera and the star tracker that
it was fitted to, in SI: with others it does not hold, and the scenario is refused.
"""

from typing import Annotated, Any, Literal, get_args

from pydantic import Discriminator, Field, Tag, model_validator
from pydantic_core import PydanticCustomError

from shefex_nav.scenario.block import Block
from shefex_nav.scenario.quantity import Number, Quantity, QuantitySpec
from shefex_nav.scenario.software import BUILT_IN
from shefex_nav.scenario.starlight import OF_LENS

NOT_OF_THE_MODEL = {  # of the star tracker: when it runs, and how its result travels
    "enabled", "on", "off", "latency", "frames", "model", "software",
}  # fmt: skip
# of the star camera: what the flux says all of, and where the world puts the stars, which is not fitted
NOT_FITTED = {**OF_LENS, "optics": {*OF_LENS["optics"], "principal_point", "distortion"}}
MOST = 8  # settings with which a model does not go that are told one by one
MODEL = "star_tracker", "model"
SAME = 1e-9  # relative; rounding of a number that was written and read


def _share(words):
    return Number("1", words, non_negative=True, at_most=1.0)


Terms = tuple[Number("0.001"), Number("1.2"), Number("1.2"), Number("0.01")]
Row = tuple[Number("8"), _share("without a fix before"), _share("soon after a fix"), _share("of them wrong")]


class SightingsFit(Block):
    """Which sources are found in a picture, and how well they are measured."""

    detection: tuple[Number("0"), Number("1"), Number("0.5")] = Field(
        description="a source is found with the probability Phi(d0 + d1 z + d2 p(L)), z the height of its "
        "light in 3x3 pixels above the threshold, in sigmas, p(L) = x^2 exp(2 - 2 x), x the length of its "
        "streak over 13 pixels"
    )
    clutter: tuple[Number("0.3", non_negative=True), Number("2", non_negative=True)] = Field(
        description="mean number of objects in a frame that are no source: always, and more with long streaks"
    )
    border: Quantity(
        "pix", "1 pix", "a source whose streak ends nearer to it is not found", non_negative=True
    )
    noise: Terms = Field(
        description="variance of a centroid: 1 px2, times its shot noise, times that of the background, "
        "times what is lost of a spot that is sharper than a pixel"
    )
    reported: Terms = Field(description="variance that is reported with it, likewise")
    saturation: (
        Quantity("electron", "1900 electron", "in one pixel: it is saturated", positive=True) | None
    ) = None
    mean_offset: Quantity("DN", "0.1 DN", "of the mean grey value against the one expected")


class IdentificationFit(Block):
    """Which frames give an attitude."""

    table: list[Row] = Field(
        description="rows of: stars of the catalogue found, share identified without and after a fix, share "
        "of these attitudes that is wrong"
    )
    named: _share("of the stars of an identified frame that get their name")
    wrong_turns: list[tuple[Number("0.1"), Number("0"), Number("0")]] = Field(
        description="rotation vectors of wrong attitudes, rad"
    )
    fastest: Quantity("rad/s", "2.5 deg/s", "rate of the frames that gave an attitude", positive=True)


class StarStatistics(Block):
    """A fitted star tracker."""

    format: Literal[3]
    made: dict[str, Any] = Field(description="by which version, from which scenario, how many runs")
    settings: dict[str, Any] = Field(description="of camera and star tracker; [a, b]: from a to b")
    digest: str = Field(description="of the fit and its settings")
    sightings: SightingsFit
    identification: IdentificationFit
    tests: list[dict[str, Any]] = Field(description="of the fit, on runs that it was not fitted to")

    @model_validator(mode="wrap")
    @classmethod
    def _as_it_was_written(cls, content, validated):
        """Refuse a file that somebody has changed: nobody has compared it with pictures."""
        model = validated(content)
        if isinstance(content, dict) and (own := digest(content)) != model.digest:
            raise PydanticCustomError(
                "changed", "is not as shefex-nav characterise wrote it: it should have the digest {given} "
                "and has {own}; characterise again", {"given": model.digest, "own": own},
            )  # fmt: skip
        return model


def _form(value):
    return "<file>" if isinstance(value, str) else "<model>"


Model = Annotated[
    Annotated[str, Tag("<file>")] | Annotated[StarStatistics, Tag("<model>")], Discriminator(_form)
]


def settings(scenario):
    """What a fitted star tracker depends on: {path: number, text or bool}, in SI, as far as it is given."""
    tracker = scenario.star_tracker.model_dump(exclude=NOT_OF_THE_MODEL)
    camera = scenario.star_camera.model_dump(exclude=NOT_FITTED)
    found = _flat(camera, ("star_camera",)) | _flat(tracker, ("star_tracker",))
    del found["star_tracker.identification.acceptance"]  # statistics are of verified attitudes: `fitness`
    return {path: value for path, value in found.items() if value is not None}


def _flat(value, path):
    """A section as {dotted path: single value}."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list | tuple):
        items = enumerate(value)
    else:
        return {".".join(map(str, path)): value}
    found = {}
    for key, inner in items:
        found |= _flat(inner, (*path, key))
    return found


def digest(content):
    """Digest of what a file says of a star tracker, and for which settings: 16 hexadecimal digits."""
    import hashlib
    import json

    said = {name: content[name] for name in ("sightings", "identification", "settings")}
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:16]


def contradictions(scenario):
    """Why the statistics of the star tracker do not hold: pairs of a field's path and text for people."""
    tracker = scenario.star_tracker
    if tracker.frames != "statistical" or not tracker.enabled:
        return
    if not isinstance(tracker.model, StarStatistics):
        words = "frames: statistical needs the file that `shefex-nav characterise` writes"
        yield MODEL, words
        return
    yield from fitness(scenario)
    yield from _miscalibrated(scenario)
    found, wanted = settings(scenario), tracker.model.settings
    for path in [path for path in wanted if path not in found]:
        words = f"the model is made for a setting {path} that there is not; characterise again"
        yield MODEL, words
    others = [path for path, value in wanted.items() if path in found and not _holds(value, found[path])]
    for path in others[:MOST]:
        place = tuple(int(part) if part.isascii() and part.isdigit() else part for part in path.split("."))
        spec = _spec(type(scenario), place)
        words = (
            f"is {_text(found[path], spec)}, the statistics of the star tracker were fitted to "
            f"{_text(wanted[path], spec)}; characterise this scenario, or fly with "
            "star_tracker.frames: rendered"
        )
        yield place, words
    if others[MOST:]:
        words = f"the model does not go with {len(others) - MOST} more settings: {', '.join(others[MOST:])}"
        yield MODEL, words
    if missing := sorted(set(found) - set(wanted)):
        words = f"the model does not say for which {missing[0]} it was made; characterise again"
        yield MODEL, words


def fitness(scenario):
    """Why there can be no statistics for a scenario's camera or way to search: as `contradictions`."""
    path = ("star_tracker", "frames")
    if scenario.star_camera.detector.shutter != "global":
        yield path, "statistics of the star tracker are of a global shutter; fly with frames: rendered"
    if scenario.star_tracker.detection.scan == "run_length":
        words = "statistics of the star tracker do not know scan: run_length; fly with frames: rendered"
        yield path, words
    if scenario.star_tracker.identification.deepest is not None:
        words = "statistics of the star tracker do not know identification.deepest; fly with frames: rendered"
        yield path, words
    if scenario.star_tracker.identification.acceptance != "verified":
        words = "statistics of the star tracker are of verified attitudes; fly with frames: rendered"
        yield path, words
    if BUILT_IN != scenario.star_tracker.software or BUILT_IN != scenario.computer.software:
        yield path, "statistics are of the built-in star tracker; fly your own with frames: rendered"


def _miscalibrated(scenario):
    """A calibration that displaces stars beyond their gates: how many are identified then is not fitted."""
    from shefex_nav.scenario import lens
    from shefex_nav.scenario.told import as_told

    left = lens.left(scenario.star_camera, as_told(scenario).star_camera)
    identification = scenario.star_tracker.identification
    gate_px = identification.gate_sigma * identification.centroid_error
    if left is not None and left.worst_px > gate_px:
        words = (
            f"(focal_length, principal_point, distortion together) leaves stars {left.worst_px:.2g} pixels "
            f"from where an attitude puts them, beyond their gate of {gate_px:.2g} pixels; statistics do not "
            "know what is identified then: fly with frames: rendered"
        )
        yield ("navigation", "told", "star_camera", "optics"), words


def with_model(scenario, content):
    """The same scenario with frames: statistical and the content of a file. Scenario, dict -> Scenario"""
    model = StarStatistics.model_validate(content)
    tracker = scenario.star_tracker.model_copy(update={"frames": "statistical", "model": model})
    return scenario.with_sections(star_tracker=tracker)


def _holds(wanted, found):
    """Whether a setting is the one of the model, or within its range."""
    low, high = wanted if isinstance(wanted, list | tuple) else (wanted, wanted)
    if isinstance(low, bool | str | None) or isinstance(found, bool | str | None):
        return low == found
    slack = SAME * max(abs(low), abs(high))
    return low - slack <= found <= high + slack


def _spec(model, path):
    """QuantitySpec of the field at a path, None if it has none."""
    from shefex_nav.scenario.messages import field_at

    annotation, metadata = field_at(model, path)
    found = [one for one in (*metadata, *get_args(annotation)) if isinstance(one, QuantitySpec)]
    return found[0] if found else None


def _text(value, spec):
    """A setting as people write it."""
    if isinstance(value, list | tuple):
        return " to ".join(_text(one, spec) for one in value)
    if spec is not None and isinstance(value, int | float):
        return spec.write(float(value))
    return f"{value:.6g}" if isinstance(value, float) else str(value)
