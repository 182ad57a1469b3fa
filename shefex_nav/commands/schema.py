"""`shefex-nav schema`: JSON Schema of scenario and replay files, messages of logs and of software."""

import json

import typer

from shefex_nav.commands.options import bad, option


def schema(
    proto: option(bool, "Print the messages of logs and of flight software, as .proto.", "--proto") = False,
    replay: option(bool, "Print the JSON Schema of files for `shefex-nav replay`.", "--replay") = False,
):
    """Print the JSON Schema of scenario files, for completion in editors."""
    if proto and replay:
        raise bad("--proto", "does not go with --replay")
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
