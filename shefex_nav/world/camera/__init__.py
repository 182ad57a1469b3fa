"""The star camera: the sky through a lens onto a detector with a global or a rolling shutter.

shutter             takes pictures on command
camera              one picture: `expose`
sky, motion         stars in the field, how they move during the exposure
movers, moon, hits  satellites and debris; the Moon; particles
optics              mounting, focal length, stray light; distortion
render              electrons on the detector
detector, artefacts grey values; bad pixels, false objects
undrawn, sightings  what would be seen where no picture is drawn
"""

from shefex_nav.world.camera.camera import Camera, expose, init

__all__ = ["Camera", "expose", "init"]
