"""Verification: the flight mechanics against trajectories that others have published."""
