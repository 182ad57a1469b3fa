"""Methods of the Improved Multi-Poles paper; PROVIDES is what a scenario can choose.

search -> clusters -> compensate   objects of two contiguous frames, at one instant
multipole                          identification
as_printed                         what we read otherwise than it is printed, as switches
chain                              both in a row, as published
"""

from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.papers.impa.methods import multipole, search

PROVIDES = [
    Method("search", "run_length", search.by_run_length),
    Method("identification", "multipole", multipole.identify),
]
