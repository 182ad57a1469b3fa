"""The page of the messages of a log and of own software, from the tables that write them."""

from mkdocs.structure.files import File

PAGE = "reference/messages.md"


def on_files(files, config, **_):
    """Put the page in the place of the one that says, in a checkout, how to make it."""
    files.remove(files.get_file_from_path(PAGE))
    files.append(File.generated(config, PAGE, content=text()))
    return files


def text():
    """Markdown of all messages."""
    from shefex_nav.log.topics import topics
    from shefex_nav.software.messages import OWN

    parts = [
        "# Messages",
        "A log is an MCAP file with these messages in protobuf; own software that runs as a program gets and "
        "gives the same, and a few more ([Own software](../how-to/software.md)). `shefex-nav schema --proto` "
        "prints them as a `.proto` file. Each begins with `timestamp_ns`, UTC since 1970. "
        "The record in Python has the fields without units in their names. "
        "SI units and radians; times are mission times. The last letter before the unit is the frame of the "
        "components: i inertial, e Earth-fixed, b body, c star camera ([Conventions](../conventions.md)).",
        "## Of a log",
    ]
    for one in topics():
        parts += _message(one)
    parts += ["## Of own software"]
    for one in OWN:
        parts += _message(one)
    return "\n\n".join(parts) + "\n"


def _message(topic):
    """Heading, comment and table of one of them."""
    yield f"### {topic.schema}"
    where = f"`{topic.topic}`" if topic.topic else ""
    rate = f"{topic.rate_hz:g} Hz" if topic.rate_hz else ""
    head = ", ".join(part for part in (where, rate) if part)
    yield f"{head}: {topic.comment}" if head else topic.comment
    rows = [f"| `{one.name}` | {_kind(one)} | {_cell(one.comment)} |" for one in topic.fields]
    if rows:
        yield "\n".join(["| field | type | meaning |", "|---|---|---|", *rows])


def _kind(field):
    """What a field holds: 'double (3,)'."""
    kind = field.kind if isinstance(field.kind, str) else field.kind.__name__
    kind = {"sfixed32": "integer"}.get(kind, kind)
    if not field.shape:
        return kind
    sizes = ["n" if not isinstance(size, int) or size < 0 else str(size) for size in field.shape]
    return f"{kind} ({', '.join(sizes)}{',' * (len(sizes) == 1)})"


def _cell(words):
    return words.replace("|", "\\|")
