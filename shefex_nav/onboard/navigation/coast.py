"""Ticks in which nothing arrives, many in one compiled call: the same arithmetic in the same order.

Most ticks of a flight only integrate, and the interpreter around the call takes longer than the arithmetic.
"""

from shefex_nav.clock import SAME_S
from shefex_nav.compiled import kernel
from shefex_nav.onboard.navigation import fusion, integrity_imu, prediction
from shefex_nav.onboard.navigation.strapdown import BEFORE
from shefex_nav.records import row

LONGEST = 32  # ticks in a call; the history needs room for them beside those that it keeps


def coast(nav, blocks, first, last):
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
    if watch.is_calm(n):
        history.make_room(n, last - first)
        done, changed = _coast(
            *nav.constants, *history.arrays, history.newest, nav.params.motors, *watch.imu,
            blocks.t_valid_s, blocks.dt_s, blocks.dtheta_b, blocks.dv_b, blocks.saturated, blocks.valid,
            first, last,
        )  # fmt: skip
    if not done:  # what is out of the ordinary, and what does not follow on the last block
        fusion.advance(nav, row(blocks, first))
        return 1
    history.extend(blocks.t_valid_s[first : first + done].tolist())
    watch.screened(history.ends_s[-1], changed)
    fusion.forget_old(nav)
    return done


@kernel
def _coast(
    at, model, C_iq, C_re, angle_0, rate, numbers, increments, extra, xs, Ps, x, P,
    newest, motors, rules, last_block, axes, ends_s, dt_s, dtheta_b, dv_b, saturated, valid, first, last,
):  # fmt: skip
    """`coast` with the fields of its tuples. -> ticks made, bits of the axes that changed in the last

    Ends before a block that does not follow on the one before it.
    """
    n, size, work = dtheta_b.shape[1], numbers.shape[0], prediction.workspace(P.shape[0])
    for block in range(first, last):
        number = newest + 1 + block - first
        k, before = number % size, (number - 1) % size
        if abs(ends_s[block] - numbers[before, 0] - n * dt_s[block]) > SAME_S:
            return block - first, 0
        changed = integrity_imu.screen_packed(
            rules, last_block, axes, ends_s[block], dt_s[block], dtheta_b[block], dv_b[block],
            saturated[block], valid[block], increments[k, BEFORE : BEFORE + n], extra[k],
        )  # fmt: skip
        prediction.enter(
            at, model, C_iq, C_re, angle_0, rate, numbers, increments, extra, xs, Ps, x, P,
            number, motors, ends_s[block], dt_s[block], n, work,
        )  # fmt: skip
        if changed:
            return block - first + 1, changed
    return last - first, 0
