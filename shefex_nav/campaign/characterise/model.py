"""Fitted statistics as the file that a scenario names; its section is `scenario.star_statistics`."""

import json

from shefex_nav import __version__
from shefex_nav.scenario import star_statistics

DIGITS = 6  # significant, of a fitted number


def section(scenario, sightings, search, made, tests, ranges=None):
    """The content of the file as plain dict.

    Parameters
    ----------
    scenario : Scenario that was flown
    sightings : SightingModel
    search : IdentificationModel
    made : dict, how the runs were made
    tests : list of dict, from `judge`
    ranges : {path of a setting: (low, high)} of settings that were dispersed
    """
    settings = star_statistics.settings(scenario)
    settings |= {path: list(values) for path, values in (ranges or {}).items() if path in settings}
    limit = sightings.saturation_electrons
    found = {
        "format": 1,
        "made": {"version": __version__, "scenario": scenario.mission.name} | made,
        "digest": star_statistics.digest(settings),
        "sightings": {
            "detection": sightings.detection.tolist(),
            "border": f"{sightings.border_px:.4g} pix",
            "noise": sightings.noise.tolist(),
            "reported": sightings.reported.tolist(),
            "saturation": f"{limit:.6g} electron" if limit < float("inf") else None,
            "mean_offset": f"{sightings.mean_offset_dn:.4g} DN",
        },
        "identification": {
            "table": [
                [int(stars), float(first), float(later), float(wrong)]
                for stars, first, later, wrong in zip(*search[:4], strict=True)
            ],
            "named": float(search.named),
            "wrong_turns": search.wrong_turns.tolist(),
            "fastest": f"{search.fastest:.9g} rad/s",
        },
        "tests": tests,
        "settings": settings,
    }
    for part in ("sightings", "identification", "tests"):
        found[part] = _rounded(found[part])
    return _without_none(found)


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


def _without_none(value):
    """Without keys that have nothing to say: a scenario file takes `null` for a key that is not there."""
    if isinstance(value, dict):
        return {key: _without_none(item) for key, item in value.items() if item is not None}
    return [_without_none(item) for item in value] if isinstance(value, list) else value
