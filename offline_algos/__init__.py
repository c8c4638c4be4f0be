"""Offline algorithms, one file each."""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
