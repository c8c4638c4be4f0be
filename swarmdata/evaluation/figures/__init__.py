"""Figures of estimates, saved to a path whose suffix is the format.

Drawing raises SchemaError for an unknown suffix, or if there is nothing to draw.
"""
