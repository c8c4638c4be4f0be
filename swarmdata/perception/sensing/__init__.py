"""Observation models: the sensors of the robots, of live worlds and of recorded data."""
