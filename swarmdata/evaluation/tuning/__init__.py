"""Random search for settings, chosen by validation episodes and by the data alone."""
