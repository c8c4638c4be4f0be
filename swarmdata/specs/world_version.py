"""The version of the worlds, which specs hold and ids end with."""

WORLD_VERSION = 1
"""The version of the worlds that this package simulates: their physics and rewards are frozen."""
