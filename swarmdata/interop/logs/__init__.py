"""Logs of robots (tables and bags) as datasets: read by a map, resampled, cut into episodes."""

from swarmdata.interop.logs.import_logs import import_logs, remake_logs

__all__ = ["import_logs", "remake_logs"]
