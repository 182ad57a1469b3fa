"""JSON Schema of a scenario or replay file, for editors that complete and check while one writes."""

import re

from pydantic.json_schema import GenerateJsonSchema

from shefex_nav.scenario.load import EXTENDS, Scenario
from shefex_nav.scenario.sensors import USE


class Named(GenerateJsonSchema):
    """Calls a section by the name of its class.

    Pydantic would take the qualified name, which for sections that are made says where pickle finds them:
    `shefex_nav/world/imu_settings:Gyro`, `Scenario:barometer,magnetometer`.
    """

    def get_defs_ref(self, core_mode_ref):
        ref, mode = core_mode_ref
        return super().get_defs_ref(
            (re.sub(r"\.(?:[\w/]+/\w+:)?(\w+)(?::[\w,]*)?:(\d+)$", r".\1:\2", ref), mode)
        )


def json_schema(model=Scenario, title="shefex_nav scenario"):
    """JSON Schema of the files that a model reads; a file that extends another need not be complete."""
    complete = model.model_json_schema(schema_generator=Named)
    blocks = complete.pop("$defs")
    complete["properties"][EXTENDS] = {
        "type": "string",
        "description": "Scenario file, relative to this one, or name of one that comes with the program, "
        "whose values hold where this file gives none",
    }
    name = model.NAME if hasattr(model, "NAME") else model.__name__
    blocks[name] = complete
    parts = {f"{name}.partial": _partial(block) for name, block in blocks.items()}
    for block in blocks.values():
        _complete_by_use(block, blocks)
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": title,
        "if": {"required": [EXTENDS]},
        "then": {"$ref": f"#/$defs/{name}.partial"},
        "else": {"$ref": f"#/$defs/{name}"},
        "$defs": blocks | parts,
    }


def _complete_by_use(block, blocks):
    """Let sections of a block that say which instrument they `use` leave out its values, in place."""
    for key, value in block.get("properties", {}).items():
        name = value.get("$ref", "").rpartition("/")[2]
        if USE in blocks.get(name, {}).get("properties", {}):
            partial = {"$ref": f"#/$defs/{name}.partial"}
            block["properties"][key] = {"if": {"required": [USE]}, "then": partial, "else": value}


def _partial(block):
    """A schema block without required keys, pointing to others like it; `null` takes any value away.

    What is not complete may be any of several forms, hence anyOf for oneOf; a form that takes the place of
    another one takes keys of that away, which it does not have itself.
    """
    if isinstance(block, list):
        return [_partial(item) for item in block]
    if not isinstance(block, dict):
        return block
    partial = {
        "anyOf" if key == "oneOf" else key: f"{value}.partial" if key == "$ref" else _partial(value)
        for key, value in block.items()
        if not (key == "required" and isinstance(value, list))
    }
    for key in ("properties", "patternProperties"):
        values = partial.get(key, {})
        partial |= (
            {key: {name: {"anyOf": [v, {"type": "null"}]} for name, v in values.items()}} if values else {}
        )
    if (others := partial.get("additionalProperties", True)) is not True:
        partial["additionalProperties"] = (
            {"anyOf": [others, {"type": "null"}]} if others else {"type": "null"}
        )
    return partial
