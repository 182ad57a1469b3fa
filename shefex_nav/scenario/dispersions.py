"""Sections of a scenario about campaigns: which of its values differ from run to run, and how.

A dispersion is written under the path of its field, as `--set` knows it:

    launch.elevation: {normal: 0.2 deg}                               added to the value of the scenario
    vehicle.payload.mass: {normal: 0.5 %, apply: scale}               a share of that value
    star_camera.artefacts.false_objects: {choice: [100, 250, 500]}    in its place

or, for values that go together, in a group with a name of its own and `paths`. What is drawn has the unit
that it is written with; whether that goes with the field is checked by `disperse.resolve`.
"""

from dataclasses import dataclass
from typing import Annotated, Any, Literal

from pydantic import Field

from shefex_nav.scenario.block import Block, forms
from shefex_nav.scenario.quantity import Number, Quantity, Reader, describe, refuse

Apply = Literal["add", "scale", "replace"]
_APPLY = "added to the value of the scenario, a share of it, or in its place"


@dataclass(frozen=True)
class AsWritten(Reader):
    """A number or a quantity as it is written, whose unit is that of a field named elsewhere."""

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        return {"type": ["string", "number"], "examples": ["0.2 deg", "5 %"]}

    def read(self, value):
        """The value itself."""
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            raise refuse(f"expected a number, with its unit if it has one, got {describe(value)}")
        return value


Written = Annotated[Any, AsWritten()]


class Normal(Block):
    """Gaussian."""

    normal: Written = Field(description="standard deviation")
    mean: Written | None = Field(default=None, description="of what is drawn; default 0")
    apply: Apply = Field(default="add", description=_APPLY)


class Truncated(Block):
    """Gaussian without its tails."""

    truncated_normal: Written = Field(description="standard deviation before the tails are cut off")
    mean: Written | None = Field(default=None, description="before the tails are cut off; default 0")
    low: Written | None = Field(default=None, description="nothing below it is drawn")
    high: Written | None = Field(default=None, description="nothing above it is drawn")
    apply: Apply = Field(default="add", description=_APPLY)


class Uniform(Block):
    """Anything between two bounds with the same probability."""

    uniform: tuple[Written, Written] = Field(description="lower and upper bound")
    apply: Apply = Field(default="add", description=_APPLY)


class LogNormal(Block):
    """The value of the scenario times a positive factor whose logarithm is Gaussian with mean 0."""

    log_normal: Quantity(
        "", "20 %", "standard deviation of the natural logarithm", positive=True, at_most="1000 %"
    )


class Choice(Block):
    """One of several values."""

    choice: list[Any] = Field(min_length=1, description="the values")
    weights: list[Number("2", "relative", non_negative=True)] | None = Field(
        default=None, description="how often each is drawn, relative to the others; default: all alike"
    )
    apply: Apply = Field(default="replace", description=_APPLY)


class ColumnOfFile(Block):
    """A column of a CSV file, of which run k takes number k."""

    file: str = Field(min_length=1, description="CSV whose first line names the columns; relative to this")
    column: str = Field(min_length=1, description="name of the column")
    unit: str = Field(default="", description="of its numbers")


class Table(Block):
    """Run k takes value number k, both counted from 0."""

    table: list[Written] = Field(min_length=1, description="values, or {file, column, unit}")
    apply: Apply = Field(default="replace", description=_APPLY)


class Group(Block):
    """Gaussian values that are correlated."""

    paths: list[str] = Field(min_length=2, description="fields")
    sigma: list[Written] | None = Field(default=None, description="standard deviations, with a correlation")
    correlation: list[list[Number("0.5", at_least=-1, at_most=1)]] | None = Field(
        default=None, description="matrix of correlations"
    )
    units: list[str] | None = Field(default=None, description="of the paths, in a covariance; '' for none")
    covariance: list[list[Number("0.01", power=2)]] | None = Field(
        default=None, description="matrix of covariances in those units"
    )
    apply: Apply = Field(default="add", description=_APPLY)


Dispersion = forms(
    ("normal", Normal),
    truncated_normal=Truncated,
    uniform=Uniform,
    log_normal=LogNormal,
    choice=Choice,
    table=Table,
    paths=Group,
)
Dispersions = dict[str, Dispersion]
KEYS = {key for form in (Normal, Truncated, Uniform, LogNormal, Choice, Table, Group) for key in form.keys()}

COVARIANCE_RATE = 10.0  # Hz, of the logged covariance, which series are taken from
OF_FLIGHT = (  # sections, and fields, that decide where the vehicle flies and how it turns
    ("mission",),
    ("earth",),
    ("atmosphere",),
    ("wind",),
    ("launch",),
    ("orbit",),
    ("ground",),
    ("trajectory",),
    ("vehicle",),
    ("attitude",),
    ("programme",),
    ("star_camera", "mounting", "boresight"),  # which the attitude programme points
    ("star_camera", "mounting", "image_right"),
)

SAMPLINGS = "random", "latin_hypercube"


class Campaign(Block):
    """How the runs of a campaign are made, and what is kept of them."""

    sampling: Literal[SAMPLINGS] = Field(
        default="random",
        description="each run draws for itself, or all runs together so that each of N equal parts of a "
        "distribution is hit once; then the number of runs must not change",
    )
    flight: Literal["dispersed", "shared"] = Field(
        default="dispersed", description="each run flies its own, or all runs have one and the same"
    )
    series: Quantity("Hz", "1 Hz", "errors and sigmas over time that are kept of each run", positive=True) = (
        "1 Hz"
    )


def contradictions(scenario):
    """(path of the field, text for people) of settings of a campaign that make no sense."""
    every = COVARIANCE_RATE / scenario.campaign.series
    if abs(every - round(every)) > 1e-9 or every < 0.5:
        words = "is not offered; take 10 Hz, the rate of the logged covariance, or a whole part of it"
        yield ("campaign", "series"), f"{scenario.campaign.series:g} Hz {words}"
    if scenario.campaign.flight == "dispersed":
        return
    for name, one in scenario.dispersions.items():
        for path in one.paths if isinstance(one, Group) else [name]:
            parts = tuple(path.split("."))
            if any(parts[: len(part)] == part for part in OF_FLIGHT):
                words = "changes the flight, which campaign.flight: shared flies once for all runs"
                yield ("dispersions", name), f"{path} {words}; take one of the two away"
