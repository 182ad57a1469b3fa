"""Pure mathematics that both wings need: rotations, the ellipsoid, frames, the pinhole camera, its lens."""
