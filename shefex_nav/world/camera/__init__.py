"""The star camera: the sky through a lens onto a detector with a global or a rolling shutter."""

from shefex_nav.world.camera.camera import Camera, expose, init

__all__ = ["Camera", "expose", "init"]
