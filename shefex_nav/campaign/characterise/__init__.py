"""The statistics of a star tracker, fitted to rendered runs: `shefex-nav characterise`.

collect   one rendered run: what stood before the camera, what the star tracker found of it
fit       runs -> the parameters of `world.camera.sightings` and `statistical`
judge     the same seeds flown with statistics: do they agree on runs that were not fitted?
model     all of it as the file that a scenario names; tables in a terminal
"""
