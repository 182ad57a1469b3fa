"""Constants against those of astropy, which has them from CODATA 2018."""

from astropy import constants as codata

from shefex_nav.environment import constants


def test_constants_are_those_of_codata():
    assert constants.SPEED_OF_LIGHT == codata.c.si.value
    assert constants.STANDARD_GRAVITY == codata.g0.si.value
