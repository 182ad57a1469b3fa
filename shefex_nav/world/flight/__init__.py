"""Six degrees of freedom from the pad to the ground."""
