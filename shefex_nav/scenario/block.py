"""What every section of a scenario has in common."""

from pydantic import BaseModel, ConfigDict


class Block(BaseModel):
    """A section of a scenario; a key that it does not know is an error."""

    model_config = ConfigDict(extra="forbid", frozen=True)
