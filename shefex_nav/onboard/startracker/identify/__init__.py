"""Star identification: lost in space, from directions alone. One method, one file, one signature.

`identify(params, pairs, u_c, flux) -> Identification`: u_c (n, 3) unit vectors in the camera and flux (n,),
brightest first; every method has its result verified against the whole field.
"""

from shefex_nav.onboard.startracker.identify import bayes, pyramid

IDENTIFIERS = {"pyramid": pyramid.identify, "bayes": bayes.identify}
