"""The page of the commands, from the program's own help."""

import typer
from mkdocs.structure.files import File

PAGE = "reference/commands.md"


def on_files(files, config, **_):
    """Put the page in the place of the one that says, in a checkout, how to make it."""
    files.remove(files.get_file_from_path(PAGE))
    files.append(File.generated(config, PAGE, content=text()))
    return files


def text():
    """Markdown of all commands."""
    from shefex_nav.commands.app import app

    parts = [
        "# Commands",
        "Made from the program's help (`--help` behind any command). Results go to stdout, progress and "
        "messages to stderr. Exit codes: 0 done; 2 bad input, one message, nothing written; 1 an internal "
        "fault, or what the command itself says; 3 software of your own failed in flight; 130 interrupted. "
        "What `--json` prints with each: [In a pipeline](../how-to/pipeline.md).",
    ]
    for name, command in commands(typer.main.get_command(app)):
        parts += _command(name, command)
    return "\n\n".join(parts) + "\n"


def commands(group, before="shefex-nav"):
    """(full name, click command) of every command, those of groups too."""
    for name, command in sorted(group.commands.items()):
        full = f"{before} {name}"
        if hasattr(command, "commands"):
            yield from commands(command, full)
        else:
            yield full, command


def _command(name, command):
    arguments = [one for one in command.params if one.param_type_name == "argument"]
    options = [one for one in command.params if one.param_type_name == "option" and one.name != "help"]
    usage = " ".join([name, *(_usage(one) for one in arguments), "[OPTIONS]" if options else ""])
    yield f"## {name.removeprefix('shefex-nav ')}"
    yield f"```text\n{usage.strip()}\n```"
    yield "\n\n".join(_unwrapped(part) for part in (command.help or "").split("\n\n"))
    rows = [f"| `{_usage(one)}` | {_cell(one.help)} | |" for one in arguments]
    rows += [f"| `{_option(one)}` | {_cell(one.help)} | {_default(one)} |" for one in options]
    if command.epilog:  # --trust, which belongs to all that read scenarios
        option, _, words = command.epilog.partition(" is ")
        rows.append(f"| `{option}` | {words} | |")
    if rows:
        yield "\n".join(["| argument, option | | default |", "|---|---|---|", *rows])


def _unwrapped(paragraph):
    return " ".join(paragraph.replace("\b", "").split())


def _usage(argument):
    words = argument.metavar or argument.name.upper() + ("..." if argument.nargs == -1 else "")
    return words if argument.required else f"[{words}]"


def _option(option):
    names = ", ".join(option.opts)
    metavar = (option.metavar or option.name.upper()).replace("|", "\\|")
    return names if option.is_flag else f"{names} {metavar}"


def _default(option):
    value = option.default
    return "" if value is None or value is False or callable(value) else f"`{value}`"


def _cell(words):
    return (words or "").replace("|", "\\|").replace("<", "&lt;").replace("\n", " ")
