"""`shefex-nav schema`: the JSON Schema of scenario files, and the messages of logs and of software."""

import json
from typing import Annotated

import typer


def schema(
    proto: Annotated[
        bool, typer.Option("--proto", help="Print the messages of logs and of flight software, as .proto.")
    ] = False,
):
    """Print the JSON Schema of scenario files, for completion in editors."""
    if proto:
        from shefex_nav.software import messages

        typer.echo(messages.proto(), nl=False)
        return
    from shefex_nav.scenario import json_schema

    typer.echo(json.dumps(json_schema.json_schema(), indent=2))
