"""What flies: star tracker, navigation, and the computer that runs them. Never imports `world`."""
