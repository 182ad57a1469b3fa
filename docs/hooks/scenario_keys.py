"""The pages of every key of a scenario and of a replay file: unit, default, range; made from the models."""

from typing import Any, Literal, get_args, get_origin

from mkdocs.structure.files import File
from pydantic_core import PydanticUndefined

SCENARIO, REPLAY = "reference/scenario.md", "reference/replay.md"
HEAD = """# Scenario files

Every section and key that a scenario file knows, made from the models that read it.

A value with a dimension is written with its unit, as engineers write it (`25 mm`, `0.1 deg/sqrt(h)`,
`1 mgee`); any unit of the same dimension will do. The column *unit* is what the program counts in, *example*
is what one writes. A key with *required* has to be there; a file that says `extends: other.yaml` takes
from there what it does not mention, and `null` takes away an optional section or an entry of a list of
names. `<name>` stands for a name of your own. Bounds are inclusive, `> 0` is not.

Where a scenario is expected, on the command line, in `Scenario.load` and behind `extends:`, a file that is
there is meant by its name. Otherwise a bare name, without a folder, means `NAME.yaml` there (behind
`extends:` beside the file that says so), or else the scenario of that name that comes with the program.
`shefex-nav scenarios` lists these, `shefex-nav scenarios NAME` prints one, and with `--copy FOLDER` it is
copied with the files that it needs. What a scenario names in turn (tables, data) stands beside it.

A section with the key `use` takes its values from a file of an instrument, found by name in the same way;
what stands beside the key comes on top. `shefex-nav instruments` lists those of the program.

`shefex-nav schema` prints the same as JSON Schema, for completion in an editor; `shefex-nav check FILE` tells
all errors of a file at once.
"""
HEAD_OF_REPLAY = """# Replay files

Every section and key of a file that says what recorded data are and what the filter is to assume of them
([Your own data](../how-to/own-data.md)), made from the models that read it. Units, `extends` and `null` are
those of [scenario files](scenario.md), and so are sections of the same name. What the filter is told stands
in `imu` and `gnss`: nobody knows the truth.

`shefex-nav schema --replay` prints the same as JSON Schema; `shefex-nav replay FILE` tells all errors of a
file at once.
"""
COLUMNS = "| key | meaning | unit | default | range | example |\n|---|---|---|---|---|---|"


def on_files(files, config, **_):
    """Put the pages in the place of those that say, in a checkout, how to make them."""
    for page in (SCENARIO, REPLAY):
        files.remove(files.get_file_from_path(page))
        files.append(File.generated(config, page, content=text(page)))
    return files


def text(page):
    """Markdown of a page."""
    from shefex_nav.replay.schema import ReplayScenario
    from shefex_nav.scenario.load import Scenario

    head, model = (HEAD, Scenario) if page == SCENARIO else (HEAD_OF_REPLAY, ReplayScenario)
    parts = [head, "## Sections", COLUMNS]
    parts[-1] += "".join(f"\n{_row(key, field)}" for key, field in model.keys().items())
    for key, field in model.keys().items():
        parts += _once(sections(key, field.annotation, set()))
    return "\n\n".join(parts) + "\n"


def _once(parts):
    """Markdown parts without those of a section that several forms of another have in common, told again."""
    known, shown = set(), True
    for part in parts:
        if part.startswith("#"):
            shown = part not in known
            known.add(part)
        if shown:
            yield part


def sections(path, annotation, seen, form=""):
    """Markdown parts of a section and of those in it, depth first; `form` tells it from others there."""
    from shefex_nav.scenario import messages

    annotation, _ = messages.bare(annotation)
    origin, arguments = get_origin(annotation), get_args(annotation)
    if messages.is_model(annotation):
        if annotation not in seen:
            yield from _section(path, annotation, {*seen, annotation}, form)
    elif origin is dict:
        yield from sections(f"{path}.&lt;name&gt;", arguments[1], seen)
    elif origin in (list, tuple):
        if arguments and arguments[0] is not Any:
            yield from sections(f"{path}[]", arguments[0], seen)
    elif arguments and origin is not Literal:  # several forms
        for option in arguments:
            model, metadata = messages.bare(option)
            if not _hidden(model):
                yield from sections(path, model, seen, _form(model, metadata))


def _section(path, model, seen, form):
    level = "##" if "." not in path and "[" not in path else "###"
    yield f"{level} {path}{f' ({form})' if form else ''}"
    if model.__doc__:
        yield " ".join(model.__doc__.split())
    rows = [_row(key, field) for key, field in model.keys().items()]
    if rows:
        yield "\n".join([COLUMNS, *rows])
    for key, field in model.keys().items():
        yield from sections(f"{path}.{key}", field.annotation, seen)


def _hidden(model):
    """A stand-in for a section whose kind is misspelt."""
    from shefex_nav.scenario import messages

    return messages.is_model(model) and model.__name__ == "Unknown"


def _form(model, metadata):
    """What tells a form of a section from the others: `task: spin`, or the key that it alone has."""
    from shefex_nav.scenario import messages

    if messages.is_model(model):
        for key, field in model.keys().items():
            values = get_args(field.annotation) if get_origin(field.annotation) is Literal else ()
            if field.is_required() and len(values) == 1 and isinstance(values[0], str):
                return f"{key}: {values[0]}"
    tags = [one.tag.strip("<>") for one in metadata if hasattr(one, "tag")]
    return f"with {tags[0]}" if tags else ""


def _row(key, field):
    spec = _spec(field.annotation, tuple(field.metadata))
    shown = _schema(field)
    words = getattr(spec, "description", "") or field.description or _words(field.annotation)
    words = words or shown.get("description", "")
    example = spec.example if spec else next(iter(shown.get("examples", ())), "")
    cells = (
        f"`{key}`",
        words,
        _kind(spec, field.annotation),
        _default(field),
        _range(spec),
        f"`{example}`" if example else "",
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _spec(annotation, metadata=()):
    """QuantitySpec or NumberSpec of a field, of the items of a list, or None."""
    from shefex_nav.scenario import messages
    from shefex_nav.scenario.quantity import NumberSpec, QuantitySpec

    annotation, metadata = messages.bare(annotation, metadata)
    found = next((one for one in metadata if isinstance(one, QuantitySpec | NumberSpec)), None)
    if found is None and get_origin(annotation) in (list, tuple):
        return _spec(get_args(annotation)[0])
    return found


def _schema(field):
    """JSON schema that a field brings itself, {} if none."""
    from pydantic import WithJsonSchema

    found = [one for one in field.metadata if isinstance(one, WithJsonSchema)]
    return found[0].json_schema if found else {}


def _kind(spec, annotation):
    from shefex_nav.scenario import messages
    from shefex_nav.scenario.quantity import QuantitySpec

    annotation, _ = messages.bare(annotation)
    if spec is not None:
        if isinstance(spec, QuantitySpec):
            kind = spec.unit or "ratio"
        else:
            kind = "whole number" if spec.whole else "number"
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is tuple and len(arguments) > 1 and arguments[1] is not Ellipsis:
            return f"{kind}, {len(arguments)} values"
        return f"{kind}, list" if origin in (list, tuple) else kind
    if get_origin(annotation) is Literal:
        return "one of " + ", ".join(f"`{_said(one)}`" for one in get_args(annotation))
    if annotation in (str, bool):
        return "text" if annotation is str else "`true`, `false`"
    if get_origin(annotation) in (list, tuple):
        return "list"
    return "section" if annotation is not Any else ""


def _words(annotation):
    """What a section says of itself."""
    from shefex_nav.scenario import messages

    annotation, _ = messages.bare(annotation)
    return " ".join((annotation.__doc__ or "").split()) if messages.is_model(annotation) else ""


def _default(field):
    from pydantic import BaseModel

    if field.is_required():
        return "*required*"
    value = field.get_default(call_default_factory=True)
    if value is PydanticUndefined or value is None or isinstance(value, BaseModel) or value in ({}, [], ()):
        return ""
    if isinstance(value, list | tuple):
        return "`[" + ", ".join(_said(one) for one in value) + "]`"
    return f"`{_said(value)}`"


def _said(value):
    return str(value).lower() if isinstance(value, bool) else str(value)


def _range(spec):
    if spec is None:
        return ""
    parts = ["> 0"] if spec.positive else []
    parts += ["≥ 0"] if spec.non_negative else []
    parts += [f"≥ {spec.at_least}"] if spec.at_least is not None else []
    parts += [f"≤ {spec.at_most}"] if spec.at_most is not None else []
    return ", ".join([*parts, *(f"or `{word}`" for word, _ in getattr(spec, "words", ()))])
