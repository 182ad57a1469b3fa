"""Attitudes from what a camera saw: lists of centroids, pictures of the night sky."""
