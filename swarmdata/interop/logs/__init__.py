"""Logs of robots (tables and bags) as datasets: read by a map, resampled, cut into episodes."""
