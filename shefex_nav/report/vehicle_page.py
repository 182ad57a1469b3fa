"""The vehicle of a scenario on one page, and as a table for people."""

from io import BytesIO

import numpy as np

from shefex_nav.files import put
from shefex_nav.report import columns, html, vehicle
from shefex_nav.report.figures import style
from shefex_nav.report.figures import vehicle as figures
from shefex_nav.report.html import element
from shefex_nav.report.table import number

CAPTIONS = (
    "What the scenario describes, to one scale. Of the whole: from where to where the centre of mass "
    "travels as propellant burns, and the centre of pressure as the Mach number changes. A payload that "
    "flies alone is open at its end: its length is not described.",
    "The static margin is that at small angles of attack, over the reference diameter; shaded below 1 "
    f"calibre. No line where the dynamic pressure is below {vehicle.FELT:g} Pa. Drag is that against the air "
    "velocity at the angle of attack as flown, parachute included. Dotted lines are events.",
)


def rows(summary):
    """(section, name, value) of a `vehicle.summary`, as texts."""
    share = summary["rail_exit_speed_over_wind"]
    beside = "no wind" if share is None else f"{share:.1f} times the wind there"
    yield "rail", "speed at its end", f"{number(summary['rail_exit_speed_m_s'], 1, 'm/s')}, {beside}"
    yield "flight", "apogee", _apogee(summary)
    for one in summary["motors"]:
        section, out_s = f"motor of {one['stage']}", one["ignition_s"] + one["burn_time_s"]
        burns = f"{one['burn_time_s']:.1f} s, T{one['ignition_s']:+.1f} s to T{out_s:+.1f} s"
        yield section, "burn time", burns
        yield section, "propellant", number(one["propellant_kg"], 1, "kg")
        yield section, "total impulse, vacuum", number(one["total_impulse_n_s"] / 1e3, 1, "kN s")
        yield section, "specific impulse, vacuum", number(one["specific_impulse_s"], 1, "s")
    for one in summary["configurations"]:
        section = one["flies"]
        yield section, "flies", f"T{one['from_s']:+.1f} s to T{one['until_s']:+.1f} s"
        yield section, "mass", " to ".join(number(m, 1, "kg") for m in one["mass_kg"])
        yield section, "centre of mass", " to ".join(number(m, 3, "m") for m in one["centre_of_mass_m"])
        yield section, "calibre", number(one["diameter_m"], 3, "m")
        for way in ("up", "down"):
            least = one[f"least_margin_{way}"]
            text = "-" if least is None else (
                f"{least['calibres']:.2f} calibres at T{least['at_s']:+.1f} s, Mach {least['mach']:.2f}"
            )  # fmt: skip
            yield section, f"least margin, way {way}", text
    yield "loads", "largest thrust", number(summary["largest_thrust_n"] / 1e3, 2, "kN")
    yield "loads", "largest drag", number(summary["largest_drag_n"] / 1e3, 2, "kN")
    pressure = number(summary["largest_dynamic_pressure_pa"] / 1e3, 1, "kPa")
    yield "loads", "dynamic pressure, way up", pressure
    yield "spin", "largest", number(summary["largest_spin_hz"], 2, "Hz")
    for one in summary["resonances"]:
        text = (
            f"T{one['at_s']:+.1f} s, {one['spin_hz']:.2f} Hz, {one['within_10_percent_s']:.1f} s within 10 %"
        )
        yield "spin", "passes resonance", text
    for one in summary["warnings"]:
        yield "warnings", one["field"], one["text"]


def _apogee(summary):
    """Height and time of the apogee, as text."""
    if summary["apogee_km"] is None:
        return "not before mission.time_limit"
    return f"{number(summary['apogee_km'], 1, 'km')} at T{summary['apogee_s']:+.1f} s"


def table(summary):
    """rich Table of a summary."""
    return columns.sections(f"{summary['scenario']}: the vehicle", rows(summary))


def write(path, looked, summary):
    """Write the page of a Looked (.html), or its figures one below the other (.png)."""
    drawn = figures.drawing(looked), figures.over_time(looked)
    if path.suffix == ".png":
        _write_png(path, drawn)
        return
    pictures = [
        style.picture(figure, f"vehicle-{k}", caption)
        for k, (figure, caption) in enumerate(zip(drawn, CAPTIONS, strict=True))
    ]
    lines, before = [], None
    for section, name, value in rows(summary):
        lines.append(("" if section == before else section, name, value))
        before = section
    title = f"{summary['scenario']}: the vehicle"
    sections = [
        ("numbers", "Numbers", [html.table("", ("", "", "value"), lines)]),
        ("figures", "Figures", pictures),
        ("scenario", "Scenario", [element("pre", looked.scenario.source)]),
    ]
    page = html.page(
        title, header=[element("h1", title)], sections=sections,
        footer="Flown once without sensors and dispersions, made by shefex_nav.",
    )  # fmt: skip
    put(path, page)


def _write_png(path, drawn):
    """Figures of one width, one below the other."""
    from matplotlib import image

    parts = [image.imread(BytesIO(style.png(figure)))[..., :3] for figure in drawn]
    width = min(part.shape[1] for part in parts)
    stream = BytesIO()
    image.imsave(stream, np.vstack([part[:, :width] for part in parts]), format="png")
    put(path, stream.getvalue())
