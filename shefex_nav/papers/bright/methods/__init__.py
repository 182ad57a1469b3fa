"""Methods of the brightness reference paper, and what it compares them with.

PROVIDES is what a scenario can choose.

centroids    centre of mass, Gaussian interpolation
brightness   identification with a brightness reference
voting       identification by geometric voting
"""

from shefex_nav.onboard.startracker.methods import Method
from shefex_nav.papers.bright.methods import brightness, centroids, voting

PROVIDES = [
    Method("centroid", "centre_of_mass", centroids.by_mass),
    Method("centroid", "gaussian_interpolation", centroids.by_interpolation),
    Method("identification", "brightness", brightness.identify),
    Method("identification", "voting", voting.identify),
]
