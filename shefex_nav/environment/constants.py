"""Constants of physics, exact by definition: BIPM, The International System of Units, 9th edition (2019)."""

SPEED_OF_LIGHT = 299792458.0  # m/s, in vacuum; section 2.2
STANDARD_GRAVITY = 9.80665  # m/s^2; 3rd CGPM (1901), in appendix 1. What pounds and specific impulses mean
