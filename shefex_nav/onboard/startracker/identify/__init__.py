"""Star identification: lost in space, from directions and brightness. One method, one file, one signature.

`identify(settings, camera, pairs, u_c, flux, P_px=None) -> Identification`: u_c (n, 3) unit vectors in the
camera and flux (n,), brightest first, P_px (n, 2, 2) the covariance of each centroid, which `bayes` uses and
the others ignore; every method has its result verified against the whole field. The methods of the literature
also have a `match(settings, camera, pairs, u_c, flux)`, the algorithm as published with the acceptance as
published.
"""

from shefex_nav.onboard.startracker.identify import bayes, brightness, multipole, pyramid, voting

IDENTIFIERS = {
    "bayes": bayes.identify,
    "pyramid": pyramid.identify,
    "brightness": brightness.identify,
    "voting": voting.identify,
    "multipole": multipole.identify,
}
