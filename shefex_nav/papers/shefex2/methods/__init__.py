"""Methods of the SHEFEX paper; PROVIDES is what a scenario can choose.

pyramid      identification as flown
calibrate    focal length, principal point and distortion from identified frames
"""

from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.papers.shefex2.methods import pyramid

PROVIDES = [Method("identification", "pyramid", pyramid.identify)]
