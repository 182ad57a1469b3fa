"""IMPA: rolling-shutter compensation and the Improved Multi-Poles Algorithm (2019).

published, methods/              figures as printed; the chain
field -> trackers -> flight      camera, sky and attitudes; its tracker and ours; the simulations
tables, figures                  of the campaign
detection, bound, centroids, centroid_tables   faintest stars, centroids and their bound
assumptions, frames              what the paper leaves open; what frames look like
experiments                      the table of experiments
"""
