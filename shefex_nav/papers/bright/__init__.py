"""BRIGHT: star identification with a brightness reference (2014).

published, methods/              figures as printed; identifications and centroids
fields, frames -> outcomes       lists of centroids, rendered frames; how the identifications did
centroids                        a star that moves
experiments                      the table of experiments
"""
