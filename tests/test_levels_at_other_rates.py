"""Protection levels of receivers that speak more often than once a second, on a real filter."""

import numpy as np
import pytest
from faulty_flight import fly


@pytest.mark.parametrize("rate_hz", [10.0, 25.0])
def test_levels_do_not_grow_with_the_number_of_late_fixes(rate_hz):
    """0.2 s late, each fix let the level run through those 0.2 s again: 20 m at 25 Hz on the pad, of 2 m."""
    once = fly("shefex2_andoya", until_s=12.0)
    often = fly("shefex2_andoya", f"gps.rate={rate_hz} Hz", until_s=12.0)
    for t_s in (-1.0, 5.0, 10.0):
        assert np.all(often.level[often.at(t_s)] < 1.1 * once.level[once.at(t_s)])
    assert np.all(np.abs(often.level_error) < often.level)
