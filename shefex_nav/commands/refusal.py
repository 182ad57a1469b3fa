"""Words of the command line about what it cannot take: one plain line `option: what would be right`.

Typer would draw a box around a sentence of its own or of pydantic's. What turns out later to be bad input, a
UserError, has its words already.
"""

import errno
import os
import re
import sys
from contextlib import nullcontext
from functools import partial
from io import TextIOWrapper

import typer
import typer.core

from shefex_nav import stopping
from shefex_nav.commands.printing import tell
from shefex_nav.errors import UserError

try:  # typer carries its own click, under no public name; until 2026 it used the package
    from typer._click import exceptions as refused
except ModuleNotFoundError:
    from click import exceptions as refused

UNREAD = 141  # exit code, as of other programs whose reader has gone (128 + SIGPIPE)
PROGRAM, TRUST = "shefex-nav", "--trust"
TRUST_HELP = f"{TRUST} is consent to run the code that a scenario names: plug-ins and own software."
MACHINE = {  # errors that are no fault of the program, and what could not be done
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EBADF), "cannot be written"),
    **dict.fromkeys(
        (errno.EIO, errno.EACCES, errno.EPERM, errno.ENAMETOOLONG, errno.ELOOP), "cannot be read or written"
    ),
    errno.EMFILE: "cannot be opened",
}
_WHOLE, _NUMBER = "expected a whole number", "expected a number"
_KINDS = {
    "int_parsing": _WHOLE,
    "int_type": _WHOLE,
    "int_from_float": _WHOLE,
    "int_parsing_size": "is too large",
    "float_parsing": _NUMBER,
    "float_type": _NUMBER,
    "finite_number": "expected a finite number",
    "greater_than_equal": "must be at least {ge}",
    "greater_than": "must be greater than {gt}",
    "less_than_equal": "must be at most {le}",
    "less_than": "must be less than {lt}",
}


class NumbersGroup(typer.core.TyperGroup):
    """Commands whose numbers are written as people write them: 1_0 is ten to Python, but to nobody else."""

    def get_command(self, ctx, cmd_name):
        """A command, each of whose options looks at what it was given."""
        found = super().get_command(ctx, cmd_name)
        for one in () if found is None else found.params:
            if not isinstance(one.process_value, partial):  # of an earlier call in this process
                one.process_value = partial(_number, one, one.process_value)
        return found


def _number(param, read, ctx, value):
    """What `read` makes of the value of an option, unless it is a number written as Python alone does."""
    made = read(ctx, value)
    if isinstance(value, str) and isinstance(made, (int, float)) and not isinstance(made, bool):
        if "_" in value or not value.isascii():
            words = f"{value}: {_WHOLE if isinstance(made, int) else _NUMBER}"
            name = _name(refused.BadParameter("", ctx=ctx, param=param))
            raise refused.BadParameter(f"{name} {words}", ctx=ctx, param_hint="")
    return made


class PlainGroup(NumbersGroup):
    """The commands, whose refusals are one message on stderr and exit code 2.

    `--trust` belongs to all of them: it is consent to run the plug-ins that a scenario names as files.
    """

    def main(self, args=None, standalone_mode=True, **more):
        """Run the command line; the process ends with its exit code."""
        more.setdefault("prog_name", PROGRAM)
        args = list(sys.argv[1:] if args is None else args)
        with _trusting(TRUST in args):
            args = [one for one in args if one != TRUST]
            if standalone_mode:
                return self._alone(args, more)
            return super().main(args, standalone_mode=False, **more)

    def invoke(self, ctx):
        """Run a command; typer ends one that is interrupted, or not read to its end, without a word."""
        asked = []
        try:
            with stopping.interruptible() as asked:
                done = super().invoke(ctx)
        except BrokenPipeError:
            sys.stdout = open(os.devnull, "w")  # Python would try again at its end
            sys.exit(UNREAD)
        except BaseException as error:
            if isinstance(error, typer.Exit) and error.exit_code == stopping.CODE:
                stopping.said()
                raise
            if not (asked or isinstance(error, KeyboardInterrupt)):
                raise
            return _interrupted()
        return _interrupted() if asked else done  # something that was called has lost the exception

    def _alone(self, args, more):
        """The whole life of the process."""
        for stream in (sys.stdout, sys.stderr):  # a terminal of plain ASCII shows ? for other letters
            if isinstance(stream, TextIOWrapper):
                stream.reconfigure(errors="replace")
        try:
            _check_letters(args)
            code = super().main(args, standalone_mode=False, **more)
        except refused.NoArgsIsHelpError as error:  # which has printed it
            sys.exit(error.exit_code)
        except refused.ClickException as error:
            tell(line(error))
            sys.exit(error.exit_code)
        except UserError as error:
            tell(error)
            sys.exit(error.exit_code)
        except OSError as error:
            if error.errno not in MACHINE:
                raise
            tell(f"{_place(error)} {MACHINE[error.errno]}: {os.strerror(error.errno)}")
            sys.exit(UserError.exit_code)
        except MemoryError as error:
            tell(f"there is not enough memory: {error}" if str(error) else "there is not enough memory")
            sys.exit(UserError.exit_code)
        sys.exit(code if isinstance(code, int) else 0)


def _interrupted():
    """Say so, and end with the code that means it."""
    tell(stopping.INTERRUPTED)
    stopping.said()
    raise typer.Exit(stopping.CODE) from None


def _check_letters(args):
    """Refuse words with bytes that are no letters: no log, table or page could hold such a name."""
    for one in args:
        try:
            one.encode()
        except UnicodeEncodeError:
            words = (
                f"is not valid {sys.getfilesystemencoding()}; rename the file, or set LC_ALL to its encoding"
            )
            raise refused.UsageError(f"{one}: {words}") from None


def _trusting(every):
    """`plugins.trusting`, imported where it is asked for."""
    if not every:
        return nullcontext()
    from shefex_nav import plugins

    return plugins.trusting()


def _place(error):
    """What could not be read or written; errors of libraries do not say it."""
    if error.filename:
        return f"{error.filename}:"
    return "the output" if MACHINE[error.errno] == "cannot be written" else "a file"


def line(error):
    """What a refused.ClickException means, for people: str."""
    if isinstance(error, refused.NoSuchOption):
        meant = " or ".join(sorted(error.possibilities or ()))
        hint = f"; did you mean {meant}?" if meant else f"; see `{_command(error)} --help`"
        return f"{error.option_name}: `{_command(error)}` has no such option{hint}"
    if isinstance(error, refused.MissingParameter):
        return f"{_name(error)}: is missing; see `{_command(error)} --help`"
    if isinstance(error, refused.BadOptionUsage):
        wants = "takes no value" if "does not take" in error.message else "expects a value"
        return f"{error.option_name}: {wants}"
    if isinstance(error, refused.BadParameter):
        return _bad_value(error)
    found = re.fullmatch(r"No such command '(.*?)'\.(?: Did you mean (.*)\?)?", error.message)
    if found:
        hint = f"did you mean {found[2]}?" if found[2] else f"see `{_command(error)} --help`"
        return f"{found[1]}: no such command; {hint}"
    found = re.fullmatch(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)", error.message)
    if found:
        return f"{found[1]}: more than `{_command(error)}` expects; see `{_command(error)} --help`"
    return error.message


def _bad_value(error):
    """About the value of an option, or of an argument, whose message names it itself."""
    told = getattr(error.__cause__, "errors", None)
    if told is not None:
        first = told()[0]
        words = first["msg"].removeprefix("Value error, ")
        if first["type"] in _KINDS:
            words = _KINDS[first["type"]].format(**first.get("ctx", {}))
        return f"{_name(error)} {first['input']}: {words}"
    name = _name(error)
    return f"{name}: {error.message}" if name.startswith("-") else error.message


def _name(error):
    """Name of the option or argument that an error is about."""
    if error.param_hint is not None:
        return error.param_hint if isinstance(error.param_hint, str) else " / ".join(error.param_hint)
    if error.param is None:
        return ""
    name = error.param.get_error_hint().strip("'")
    return name if name.startswith("-") else name.upper()


def _command(error):
    """`shefex-nav run` of an error in `run`."""
    return PROGRAM if error.ctx is None else error.ctx.command_path
