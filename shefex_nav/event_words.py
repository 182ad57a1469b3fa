"""Names of events as people say them; logs, JSON and scenarios have them with underscores."""

import re


def in_words(name):
    """`altitude_60km` as `down to 60 km`, `fault_gyro_end` as `fault ends: gyro`, no underscores."""
    words = re.sub(r"^altitude (\d+)km$", r"down to \1 km", name.replace("_", " "))
    found = re.fullmatch(r"fault (.*?)( end)?", words)
    return words if found is None else f"fault {'ends' if found[2] else 'begins'}: {found[1]}"
