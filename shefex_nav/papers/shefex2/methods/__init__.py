"""Methods of the SHEFEX paper; PROVIDES is what a scenario can choose.

single_pixels   scan as printed
pyramid         identification as flown
calibrate       focal length, principal point and distortion from identified frames
"""

from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.papers.shefex2.methods import pyramid
from shefex_nav.papers.shefex2.methods.single_pixels import single_pixels

PROVIDES = [
    Method("scan", "single_pixels", single_pixels),
    Method("identification", "pyramid", pyramid.identify),
]
