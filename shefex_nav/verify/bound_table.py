"""Errors over their bound: as an object for other programs, as a table for people."""

from math import degrees

from shefex_nav.report import columns

QUANTITIES = ("position, m", "velocity, m/s", "attitude, deg")


def as_numbers(scenario, first, seeds, ratios):
    """Plain dict for JSON. Scenario, seed of the first run, number of runs, `over_bound.ratios`"""
    phases = {name: {key: column.tolist() for key, column in one.items()} for name, one in ratios.items()}
    return {
        "scenario": scenario.mission.name,
        "first_seed": first,
        "seeds": seeds,
        "order": ["position_m", "velocity_m_s", "attitude_rad"],
        "phases": phases,
    }


def table(ratios, seeds):
    """rich Table of `over_bound.ratios` of so many runs."""
    title = f"rms error of {seeds} runs and the posterior Cramer-Rao bound, 3D"
    heads = ("phase", "", ">error", ">reported sigma", ">bound", ">error/bound", ">gravity known")
    found = columns.table(title, heads, no_wrap=True)
    for phase, values in ratios.items():
        for q, quantity in enumerate(QUANTITIES):
            sizes = [float(values[key][q]) for key in ("error", "sigma", "bound")]
            sizes = [degrees(size) for size in sizes] if q == 2 else sizes
            shares = [f"{values[key][q]:.2f}" for key in ("ratio", "ratio_known")]
            found.add_row(phase if q == 0 else "", quantity, *(f"{size:.3g}" for size in sizes), *shares)
        found.add_section()
    return found
