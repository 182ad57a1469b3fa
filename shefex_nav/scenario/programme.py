"""Section of a scenario about the attitude programme: tasks, one after the other, each with its name."""

from typing import Annotated

from pydantic import Field

from shefex_nav.scenario.block import kinds
from shefex_nav.scenario.of_settings import section
from shefex_nav.world.flight import tasks

Name = Annotated[str, Field(pattern=r"^[\w-]+$", description="one word")]
Programme = dict[Name, kinds("task", *map(section, tasks.KINDS))]
