"""The star camera: the sky through a lens onto a CCD, as 8-bit frames."""

from shefex_nav.world.camera.camera import Camera, CameraParams, expose, init

__all__ = ["Camera", "CameraParams", "expose", "init"]
