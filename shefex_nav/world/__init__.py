"""What happens: the flight, and what sensors make of it. Never imported by `onboard`."""
