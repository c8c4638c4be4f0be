"""Figures of estimates: what they show comes in as numbers, names and looks.

A function that draws saves to a path whose suffix is the format. It raises SchemaError if there is
nothing to draw or the suffix is unknown, and MissingExtraError if matplotlib is not installed.
"""
