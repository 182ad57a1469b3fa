"""The table of a comparison, for people."""

from rich.text import Text

from shefex_nav.report import columns

GROUPS = {
    "latitude, longitude": ("latitude", "longitude"),
    "yaw, pitch, roll": ("yaw", "pitch", "roll"),
    "body rates": ("roll_rate", "pitch_rate", "yaw_rate"),
    "velocity n, e, d": ("velocity_north", "velocity_east", "velocity_down"),
}


def comparison_table(flown):
    """rich Table of the cases flown; of axes that belong together, the worst is shown."""
    simulators = sorted({name for one in flown for c in one.comparisons.values() for name in c.against})
    numbers = (f">{name}" for name in (*simulators, "among them", "allowed"))
    heads = ("case", "quantity", "unit", *numbers, "")
    table = columns.table("Largest difference from each simulator", heads, no_wrap=True)
    table.columns[0].no_wrap = False
    for one in flown:
        for k, (name, comparison) in enumerate(_lines(one.comparisons)):
            differences = (_number(comparison.against.get(s)) for s in simulators)
            verdict = Text("good", style="green") if comparison.ok else Text("FAILS", style="bold red")
            table.add_row(
                f"{one.number} {one.title}" if k == 0 else "",
                name,
                comparison.quantity.unit,
                *differences,
                _number(comparison.spread),
                _allowed(comparison.tolerance),
                verdict,
            )
        table.add_section()
    return table


def _lines(comparisons):
    """(title, Comparison) per line: single quantities, and the worst one of each group."""
    grouped = {name: title for title, names in GROUPS.items() for name in names}
    done = set()
    for name, comparison in comparisons.items():
        title = grouped.get(name)
        if title is None:
            yield name.replace("_", " "), comparison
        elif title not in done:
            done.add(title)
            members = [comparisons[n] for n in GROUPS[title] if n in comparisons]
            yield title, max(members, key=lambda c: (not c.ok, max(c.against.values()) / c.tolerance.value))


def _number(value):
    return "-" if value is None else f"{value:.2g}"


def _allowed(tolerance):
    text = f"{100.0 * tolerance.value:g} %" if tolerance.relative else f"{tolerance.value:.2g}"
    return f"{text} at {len(tolerance.at_s)} times" if tolerance.at_s else text
