"""Figures of estimates, saved to a path whose suffix is the format.

Callers make sure that there is something to draw.
"""
