"""Camera paths that nobody wants to write by hand, and what the cameras of a path see."""
