"""Frozen data that describes tasks, rules, sensors, radios, spaces and the origins of datasets."""

WORLD_VERSION = 1
"""The version of the worlds that this package simulates: their physics and rewards are frozen."""
