"""The physical world both wings model: gravity, air, sky, satellites."""
