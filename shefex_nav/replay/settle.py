"""An alignment whose heading, or roll on a rail, is hardly known: found from the first motion that shows it.

The recorded data are at hand, so that is done before the navigation begins: several filters start at
different angles and go through the data until they agree (`onboard.navigation.hypotheses`). The navigation
begins there.
"""

import numpy as np

from shefex_nav.onboard.navigation import fusion
from shefex_nav.onboard.navigation.hypotheses import Bank, is_wide
from shefex_nav.records import GpsFix, StarFix, row
from shefex_nav.replay import params
from shefex_nav.scenario.data_table import DataError

HEADING = (
    "what is not known shows when the vehicle accelerates along the ground; give a heading, or more of the "
    "motion"
)
HINTS = {
    "rail": "gravity shows the roll about the nose as imu.accelerometer.bias allows: a smaller one, if "
    "the sensors are that good, or a rail that leans more"
}


def settle(scenario, data, alignment, earth, blocks_from):
    """Alignment that one filter can start from: the same, or a later one.

    Parameters
    ----------
    scenario, data, alignment, earth : ReplayScenario, Dataset, Alignment, EarthRotation
    blocks_from : function of a time [s] -> ImuBlock of arrays from there on

    Returns
    -------
    Alignment, and its time before [s], None if it is the same

    Raises
    ------
    DataError : the data end before the filters agree
    """
    if not is_wide(alignment):
        return alignment, None
    blocks = blocks_from(alignment.t_valid_s)
    if not len(blocks.t_valid_s):
        return alignment, None  # the caller says so
    bank = Bank(params.nav_params(scenario, float(blocks.dt_s[0])), alignment, earth)
    mixture = None
    for mixture in mixtures(bank, blocks, data.received):
        if mixture.is_settled:
            return mixture.alignment(), alignment.t_valid_s
    raise DataError(_not_found(alignment, mixture, HINTS.get(scenario.alignment.method, HEADING)))


def _not_found(alignment, mixture, hint):
    begin = f"from {alignment.t_valid_s:g} s on"
    if mixture is None:
        return f"alignment: the heading is not known, and there is no fix {begin} to find it by"
    words = f"to {min(np.degrees(mixture.sigma), 180.0):.0f} deg only (1 sigma) at {mixture.t_s:g} s"
    if mixture.others > 0.01:
        words += f", with another answer of weight {mixture.others:.2g}"
    return f"alignment: {begin} the data show the attitude {words}; {hint}"


def mixtures(bank, blocks, received):
    """Go through blocks and what is received with a Bank; Mixture after every tick in which a fix arrived.

    received : GpsFix, GpsRanges and readings of instruments, in any order; a StarFix is not used
    """
    start_s = bank.members[0].nav.history.ends_s[-1]
    waiting = [one for one in received if one.t_valid_s > start_s and not isinstance(one, StarFix)]
    waiting.sort(key=lambda one: one.t_available_s, reverse=True)
    for k in range(len(blocks.t_valid_s)):
        block, arrived = row(blocks, k), []
        while waiting and waiting[-1].t_available_s <= block.t_valid_s + 1e-6:
            arrived.append(waiting.pop())
        for member in bank.members:
            fusion.advance(member.nav, block)
            if arrived:
                fusion.take(member.nav, arrived)
        if any(isinstance(one, GpsFix) for one in arrived):
            bank.prune()
            yield bank.mixture()
