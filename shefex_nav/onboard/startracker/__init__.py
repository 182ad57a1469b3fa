"""Star tracker software: from a frame to an attitude, lost in space, ten times a second (`tracker`)."""
