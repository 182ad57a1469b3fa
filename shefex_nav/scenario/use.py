"""The key `use` of a section: the name of the instrument whose values the section takes.

It belongs to files, not to what is read of them: `layers` puts the instrument's values in its place.
"""

from dataclasses import dataclass
from typing import Annotated, Any

from pydantic_core import core_schema

from shefex_nav.scenario.quantity import describe, refuse

USE = "use"


@dataclass(frozen=True)
class Instrument:
    """Type of the key: whatever is still there once files have been read had no file to be read from."""

    example: str = "ln_200s"

    def __get_pydantic_core_schema__(self, source: Any, handler: Any):
        return core_schema.no_info_plain_validator_function(self.read)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any):
        return {"type": "string", "examples": [self.example]}

    def read(self, value):
        """None, as nothing is left of the key."""
        if value is None:
            return None
        raise refuse(f"names an instrument, which only a scenario file or --set can, got {describe(value)}")


Use = Annotated[Any, Instrument()]  # of an IMU
