"""The task `pursuit`: robots surround and capture evaders that are faster than they are."""
