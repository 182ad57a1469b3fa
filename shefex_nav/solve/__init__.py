"""Attitudes from what a camera saw: lists of centroids, pictures of the night sky.

picture, field, deep             a picture; its objects
patterns, triangles              attitudes and scales that it may have
lens, proof                      the camera, adjusted; the odds of the result
centroids, camera, given         for lists of centroids, with a known camera
image, overlay, table            a picture from beginning to end; drawn; printed
"""
