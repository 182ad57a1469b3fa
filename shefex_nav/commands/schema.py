"""`shefex-nav schema`: JSON Schema of scenario and replay files, messages of logs and of software."""

import json
from typing import Annotated

import typer


def schema(
    proto: Annotated[
        bool, typer.Option("--proto", help="Print the messages of logs and of flight software, as .proto.")
    ] = False,
    replay: Annotated[
        bool, typer.Option("--replay", help="Print the JSON Schema of files for `shefex-nav replay`.")
    ] = False,
):
    """Print the JSON Schema of scenario files, for completion in editors."""
    if proto and replay:
        raise typer.BadParameter("does not go with --replay", param_hint="--proto")
    if proto:
        from shefex_nav.software import messages

        typer.echo(messages.proto(), nl=False)
        return
    from shefex_nav.scenario import json_schema

    if replay:
        from shefex_nav.replay.schema import ReplayScenario

        found = json_schema.json_schema(ReplayScenario, "shefex_nav replay")
    else:
        found = json_schema.json_schema()
    typer.echo(json.dumps(found, indent=2))
