"""Star identification: lost in space, from directions and brightness. One method, one file, one signature.

`identify(settings, camera, pairs, u_c, flux, P_px=None) -> Identification`: u_c (n, 3) unit vectors in the
camera and flux (n,), brightest first, P_px (n, 2, 2) the covariance of each centroid, which `bayes` uses;
every method has its result verified against the whole field. Those of the literature stand with their papers
(`papers/*/methods`) and ignore P_px; they also have a `match(settings, camera, pairs, u_c, flux)`, the
algorithm as published with the acceptance as published.
"""

from shefex_nav.onboard.startracker.identify import bayes
from shefex_nav.onboard.startracker.methods import Table

IDENTIFIERS = Table("identification", bayes=bayes.identify)
