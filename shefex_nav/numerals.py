"""Numbers in the text of data files: what counts as one is said here, for all of them.

A number is written in ASCII digits, with a point, if with any, and perhaps an exponent: `12`, `-0.5`, `.5`,
`1e-3`. float() takes more, which no data file means: `1_000`, `nan`, `infinity`, digits of other scripts, and
1e400, of which it makes an infinity.
"""

import math
import re

NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
LONGEST = 40  # characters of a text that are shown


def number(text):
    """The float that a text means, blanks around it aside; ValueError says what it is if it is no number."""
    bare = text.strip(" \t\r\n")
    if not NUMBER.fullmatch(bare):
        got = shown(bare) if bare else "nothing"
        raise ValueError(f"expected a number such as 12.5, got {got}")
    value = float(bare)
    if not math.isfinite(value):
        raise ValueError(f"expected a number below 1e308, got {shown(bare)}")
    return value


def is_number(text):
    """Whether a text means a number."""
    try:
        number(text)
    except ValueError:
        return False
    return True


def shown(text):
    """A text in quotes, its beginning alone if it is long."""
    return repr(text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}...")
