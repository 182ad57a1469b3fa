"""Ticks in which nothing arrives, many in one compiled call: the same arithmetic in the same order.

Most ticks of a flight only integrate, and the interpreter around the call takes longer than the arithmetic.
"""

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import inner, kernel, lent
from shefex_nav.onboard.navigation import fusion, integrity_imu, prediction
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.records import ImuBlock, row

LONGEST = 32  # ticks in a call; the history needs room for them beside those that it keeps


def advance(nav, blocks, first, last):
    """Up to last - first ticks on, in which nothing arrives: `fusion.advance` with each block, and faster.

    Ends early, after a tick in which the health of the unit has changed, or when it has done many.

    Parameters
    ----------
    nav : fusion.Filter
    blocks : ImuBlock of arrays, of which rows first ... last - 1 are meant

    Returns
    -------
    done : int, ticks that were made, at least one
    """
    history, watch, n = nav.history, nav.watch, blocks.dtheta_b.shape[1]
    done, last = 0, min(last, first + LONGEST)
    last = first + watch.steady(blocks.t_valid_s[first:last].tolist())
    if watch.is_calm(n) and not nav.constants.driving:  # what a block drives, Python says tick by tick
        history.make_room(n, last - first)
        done, changed = _advance(
            nav.constants, history.arrays, history.newest, nav.params.motors, watch.imu, blocks, first, last
        )
    if not done:  # what is out of the ordinary, and what does not follow on the last block
        fusion.advance(nav, row(blocks, first))
        return 1
    history.extend(blocks.t_valid_s[first : first + done].tolist())
    watch.screened(history.ends_s[-1], changed)
    fusion.forget_old(nav)
    return done


@kernel
def _advance(constants, memory, newest, motors, screen, blocks, first, last):
    """`advance` with what of a Filter is compiled. -> ticks made, bits of the axes that changed in the last

    Ends before a block that does not follow on the one before it.
    """
    constants, memory, motors, screen, blocks = lent((constants, memory, motors, screen, blocks))
    numbers, increments, extra = memory.numbers, memory.increments, memory.extra
    n, size, work = blocks.dtheta_b.shape[1], numbers.shape[0], prediction.workspace(memory.P.shape[0])
    for m in range(first, last):
        number, block = newest + 1 + m - first, _block(blocks, m)
        k, before = number % size, (number - 1) % size
        if abs(block.t_valid_s - numbers[before, 0] - n * block.dt_s) > SAME_S:
            return m - first, 0
        changed = integrity_imu.screen_packed(screen, block, increments[k, BEFORE : BEFORE + n], extra[k])
        prediction.enter(constants, memory, number, motors, block.t_valid_s, block.dt_s, n, work)
        if changed:
            return m - first + 1, changed
    return last - first, 0


@inner(forceinline=True)
def _block(blocks, m):
    """Block m of an ImuBlock of arrays."""
    t_s, dt_s, valid = blocks.t_valid_s[m], blocks.dt_s[m], blocks.valid[m]
    dtheta_b, dv_b = blocks.dtheta_b[m], blocks.dv_b[m]
    return ImuBlock(t_s, blocks.t_available_s[m], dt_s, dtheta_b, dv_b, blocks.saturated[m], valid)
