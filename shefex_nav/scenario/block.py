"""What every section of a scenario has in common, and sections that come in several forms."""

from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag, WithJsonSchema, create_model

AUTOMATIC = "automatic"  # in place of a choice that is left to the program


class Block(BaseModel):
    """A section of a scenario; a key that it does not know is an error.

    A default is written as in a scenario file, with its unit.
    """

    # what checks a section is built when something is checked: once for a scenario, not for each of its parts
    model_config = ConfigDict(extra="forbid", frozen=True, validate_default=True, defer_build=True)
    EXAMPLE: ClassVar[str] = "base.yaml"  # a file that others extend
    NEEDED_UNLESS: ClassVar[dict] = {}  # field that may be left out where another is given: {field: other}

    @classmethod
    def keys(cls):
        """Keys as they are written in a scenario file: {key: FieldInfo}."""
        return {field.alias or name: field for name, field in cls.model_fields.items()}

    def with_sections(self, **sections):
        """The same with others in their place, of which no text says anything: for a step of the program."""
        return BaseModel.model_copy(self, update=sections)


BAD_KEY = "[key]"  # pydantic's last step to a key, not to its value


def is_tag(part):
    """Whether a part of an error's location names a form (`<file>`), not a key of the scenario."""
    return isinstance(part, str) and part.startswith("<")


def forms(otherwise, **by_key):
    """Type of a section in one of several forms, told apart by the first of `by_key` that is there.

    Parameters
    ----------
    otherwise : (key, Block) of the form that is meant if there is none of them
    by_key : the other forms; the key that tells each
    """
    models = {**by_key, otherwise[0]: otherwise[1]}

    def choose(value: Any):
        if isinstance(value, Block):
            return next((f"<{key}>" for key, model in models.items() if type(value) is model), None)
        present = value if isinstance(value, dict) else ()
        return f"<{next((key for key in by_key if key in present), otherwise[0])}>"

    return tagged(choose, models)


def with_field(model, path, kind, **made):
    """A section in which one field, at a path of keys, is of another type, or is new.

    kind : of the type that there was, None if it is new, gives the one that there is to be
    made : of a new one, as pydantic.Field takes it
    """
    name, *rest = path
    field = model.model_fields.get(name)
    if rest:
        own = with_field(field.annotation, rest, kind, **made)
        factory = own if field.default_factory is field.annotation else field.default_factory
    else:
        own, factory = kind(field and field.annotation), field and field.default_factory
    if field is None:
        info = Field(default=None, **made)
    else:
        given = {"default": field.default} if factory is None else {}
        info = Field(default_factory=factory, description=field.description, **given)
    fields = {name: (own, info)}
    return create_model(
        model.__name__, __base__=model, __module__=model.__module__, __doc__=model.__doc__, **fields
    )


@cache
def with_word(model, path, word):
    """A section in which the words that may stand at a path are one more."""
    return with_field(model, path, lambda words: Literal[(*get_args(words), word)])


class UnknownKind(Block):
    """Stands for a section whose kind is missing or misspelt."""

    model_config = ConfigDict(extra="ignore")


def kinds(key, *models):
    """Type of a section of one of several kinds, told apart by the value of `key`, a Literal in each."""
    return tagged(*by_kind(key, *models))


def by_kind(key, *models):
    """What `tagged` takes for such kinds: function of a value that gives its tag, {kind: type}.

    A kind that is missing or misspelt is what is complained about, not the other keys.
    """
    known = {get_args(model.model_fields[key].annotation)[0]: model for model in models}
    unknown = create_model("Unknown", __base__=UnknownKind, **{key: (Literal[tuple(known)], ...)})

    def choose(value: Any):
        if isinstance(value, Block):
            return f"<{getattr(value, key, key)}>"
        kind = value.get(key) if isinstance(value, dict) else None
        return f"<{kind}>" if isinstance(kind, str) and kind in known else f"<{key}>"

    return choose, {**known, key: Annotated[unknown, WithJsonSchema({"not": {}})]}


def tagged(choose, models):
    """Union of the types in `models`; `choose` takes the value and returns `<key>` of one of them."""
    members = tuple(Annotated[model, Tag(f"<{key}>")] for key, model in models.items())
    return Annotated[Union[members], Discriminator(choose)]  # noqa: UP007 the members are known at run time


def choices(model, place=""):
    """'gps.mode=tight', 'launch' and the like, for all sections of a scenario: frozenset of str."""
    found = set()
    for name, field in type(model).model_fields.items():
        value, here = getattr(model, name), f"{place}{name}"
        if isinstance(value, BaseModel):
            found |= {here, *choices(value, f"{here}.")}
        elif isinstance(value, bool) or (isinstance(value, str) and value in _words(field.annotation)):
            found.add(f"{here}={value}")
        elif isinstance(value, dict | list | tuple) and value:
            found |= {here, *_inside(value, here)}
    return frozenset(found)


def _inside(values, place):
    """Choices of sections in a list, whatever their order."""
    values = values.values() if isinstance(values, dict) else values
    return {one for value in values if isinstance(value, BaseModel) for one in choices(value, f"{place}.")}


def _words(annotation):
    """The words of all Literals in an annotation: set."""
    if get_origin(annotation) is Literal:
        return {one for one in get_args(annotation) if isinstance(one, str)}
    return set().union(*(_words(one) for one in get_args(annotation)))
