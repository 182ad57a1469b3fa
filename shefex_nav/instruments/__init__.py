"""The table of instruments that add to IMU, GPS and star camera: one file each, or one with its two halves.

The generic code walks this table and names none of them. Plug-ins add to it (`plugins`).
"""

from shefex_nav.instruments.barometer import BAROMETER
from shefex_nav.instruments.magnetometer import MAGNETOMETER
from shefex_nav.instruments.sun_sensor import SUN_SENSOR

BUILT_IN = {one.name: one for one in (BAROMETER, MAGNETOMETER, SUN_SENSOR)}
TABLE = dict(BUILT_IN)  # and those of the plug-ins that this process has loaded
OWN_STATES = {}  # name -> blocks.OwnState of the plug-ins that this process has loaded


def outer_states():
    """Blocks of states of instruments and plug-ins: list of StateBlock and OwnState."""
    return [*(block for one in TABLE.values() for block in one.states), *OWN_STATES.values()]


def state_sizes():
    """{name: number of errors} of these."""
    return {block.name: block.size for block in outer_states()}
