"""Whether a barometer says what the air weighs where the vehicle starts: units that are wrong are told.

The pressure at a height differs from that of the standard atmosphere by a few percent, with the weather; a
wrong unit changes it by a factor of seven and more.
"""

import numpy as np

from shefex_nav.environment import atmosphere
from shefex_nav.geometry import wgs84
from shefex_nav.scenario.data_table import DataError

WEATHER = 0.12  # [E] share by which the pressure may differ: 1000 m of wrong height, or a record low
FIRST = 20  # readings
UNITS = {"Pa": 1.0, "hPa or mbar": 100.0, "kPa": 1000.0, "mmHg": 133.322, "psi": 6894.76, "bar": 1e5}


def check(scenario, data):
    """DataError if the first readings cannot be pressures of the air at the first fix, in the unit said."""
    fixes = [fix for fix in data.fixes if fix.valid]
    pressures = data.readings.get("barometer", ())
    if not pressures or not fixes:
        return
    pressure = float(np.median([one.pressure for one in pressures[:FIRST]]))
    height = wgs84.geodetic_from_ecef(fixes[0].r_ea_e)[2]
    standard = float(atmosphere.us76(height)[1])
    if abs(pressure / standard - 1.0) < WEATHER:
        return
    columns = scenario.data.barometer
    said = columns.pressure_unit.factor if columns.pressure else 1.0
    words = f"the first readings are {pressure:.4g} Pa; at {height:.0f} m the air has about {standard:.4g} Pa"
    fitting = [
        name for name, factor in UNITS.items() if abs(pressure / said * factor / standard - 1.0) < WEATHER
    ]
    hint = (
        f"they fit as {fitting[0]}" if fitting and columns.pressure else "check data.barometer and the height"
    )
    field = "data.barometer.pressure_unit" if columns.pressure else "data.barometer.height"
    raise DataError(f"{field}: {words}; {hint}")
