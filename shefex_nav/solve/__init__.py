"""Attitudes from what a camera saw: lists of centroids, pictures of the night sky.

picture, header, deep            a picture; what its file tells of it
background, field, foreground    its background and noise; its objects; which of them are no stars
patterns, triangles, search      attitudes, scales and laws of lenses that it may have
lens, proof                      the camera, adjusted; the odds of the result
naming, names                    all its stars, and the attitude with covariance that they make together
steps                            the compiled loops of lens
centroids, camera, given         for lists of centroids, with a known camera
told                             a picture of a star camera that is known, by the star tracker that flies
image, solution, table, stages   a picture from beginning to end; printed; drawn
"""
