"""`shefex-nav schema`: the JSON Schema of scenario files."""

import json

import typer


def schema():
    """Print the JSON Schema of scenario files, for completion in editors."""
    from shefex_nav.scenario import json_schema

    typer.echo(json.dumps(json_schema.json_schema(), indent=2))
