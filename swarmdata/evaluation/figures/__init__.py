"""Figures of estimates, saved to a path whose suffix is the format; there is something to draw."""
