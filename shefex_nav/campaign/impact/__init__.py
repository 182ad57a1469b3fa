"""Where a rocket and its stages land: one flight, many, and the launcher's setting for a wished place."""
