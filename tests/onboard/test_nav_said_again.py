"""A star fix or a reading of an instrument that arrives again says nothing new, whatever comes between."""

import numpy as np
import pytest
from navigation_flight import ARCSEC, EARTH, PARAMS, alignment, fly, star_fix
from test_nav_barometer import AID, on_the_pad, stand

from shefex_nav.onboard.navigation import fusion

BLOCKS, STATES = fly(1.0)


@pytest.mark.parametrize("late_s", [0.0, 0.2])
def test_a_star_fix_counts_once(late_s):
    """Five times the same: the sigma of the attitude would fall by the root of five."""
    fixes = [
        star_fix(BLOCKS, STATES, t_s, 0.05, np.random.default_rng(k)) for k, t_s in enumerate((0.4, 0.65))
    ]
    ends = []
    for times in (1, 5):
        nav, notes = fusion.start(PARAMS, alignment(STATES[0]), EARTH), []
        for k, block in enumerate(BLOCKS, 1):
            fusion.advance(nav, block)
            for fix in fixes:
                due = [round(100 * (fix.t_available_s + late_s * (m > 0))) == k for m in range(times)]
                arrived = [("star_tracker", fix)] * sum(due)
                notes += [result.note for result in fusion.fuse(nav, arrived)] if arrived else []
        ends.append(nav.history[-1])
        assert nav.health["star_tracker"].used == 1  # the first waited for the second
        assert sum(note.startswith("stale: of T") for note in notes) == 2 * (times - 1)
    np.testing.assert_array_equal(ends[0].P, ends[1].P)
    np.testing.assert_array_equal(ends[0].x, ends[1].x)
    assert np.sqrt(np.diag(ends[0].P)[6:9]).max() > 20.0 * ARCSEC


def test_a_reading_counts_once():
    """Of a barometer, whose errors that last are counted apart, and whose noise is not."""
    readings = on_the_pad(20)
    once, _ = stand(readings, 20)
    again, gates = stand([one for one in readings for _ in range(3)], 20)
    np.testing.assert_array_equal(once.history.P, again.history.P)
    assert sum(gate.note.startswith("stale") for gate in gates if gate.sensor == AID.name) == 2 * len(
        readings
    )
