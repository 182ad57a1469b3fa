"""Fitted statistics as the file that a scenario names; its section is `scenario.star_statistics`."""

import json

from shefex_nav import __version__
from shefex_nav.scenario import star_statistics

DIGITS = 6  # significant, of a fitted number


def section(scenario, sightings, search, made, ranges=None):
    """The content of the file as plain dict, still without tests.

    Parameters
    ----------
    scenario : Scenario that was flown
    sightings : SightingModel
    search : IdentificationModel
    made : dict, how the runs were made
    ranges : {path of a setting: (low, high)} of settings that were dispersed
    """
    settings = star_statistics.settings(scenario)
    settings |= {path: list(values) for path, values in (ranges or {}).items() if path in settings}
    found = {
        "sightings": _rounded(_sightings(sightings)),
        "identification": _rounded(_identification(search)),
        "tests": [],
        "settings": settings,
    }
    made = {"version": __version__, "scenario": scenario.mission.name} | made
    return {"format": 3, "made": made, "digest": star_statistics.digest(found)} | found


def with_tests(content, tests):
    """The content with what a list of judge.Test found."""
    return content | {"tests": [_rounded(one.as_dict()) for one in tests]}


def _sightings(model):
    found = {
        "detection": model.detection.tolist(),
        "border": f"{model.border_px:.4g} pix",
        "clutter": model.clutter.tolist(),
        "noise": model.noise.tolist(),
        "reported": model.reported.tolist(),
        "mean_offset": f"{model.mean_offset_dn:.4g} DN",
    }
    limit = model.saturation_electrons  # a scenario file has no infinity; nothing is saturated without it
    return found | ({"saturation": f"{limit:.6g} electron"} if limit < float("inf") else {})


def _identification(model):
    return {
        "table": [
            [int(stars), float(first), float(later), float(wrong)]
            for stars, first, later, wrong in zip(*model[:4], strict=True)
        ],
        "named": float(model.named),
        "wrong_turns": model.wrong_turns.tolist(),
        "fastest": f"{model.fastest:.9g} rad/s",
    }


def text(content):
    """JSON with one line for each entry of a section; readable, and a few kB."""
    lines = []
    for name, value in content.items():
        if isinstance(value, dict):
            inner = ",\n".join(f"    {json.dumps(key)}: {_json(item)}" for key, item in value.items())
            lines.append(f"  {json.dumps(name)}: {{\n{inner}\n  }}")
        elif isinstance(value, list):
            inner = ",\n".join(f"    {_json(item)}" for item in value)
            lines.append(f"  {json.dumps(name)}: [\n{inner}\n  ]")
        else:
            lines.append(f"  {json.dumps(name)}: {_json(value)}")
    return "{\n" + ",\n".join(lines) + "\n}\n"


def _json(value):
    return json.dumps(value, allow_nan=False)


def _rounded(value):
    """Floats with as many digits as they deserve."""
    if isinstance(value, dict):
        return {key: _rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_rounded(item) for item in value]
    return float(f"{value:.{DIGITS}g}") if isinstance(value, float) else value
