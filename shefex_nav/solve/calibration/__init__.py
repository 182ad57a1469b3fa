"""Calibration of a star camera from its own pictures of the night sky.

`pictures` solves and reads them one by one, `lens_fit` adjusts one lens to all, if they have one, `spots`,
`noise` and `hot_pixels` find what the detector does; `calibrate` puts them together.
"""
