"""Answers on other sensors, radios, arenas and teams than those of the data or the training."""
