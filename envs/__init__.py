"""Simulated worlds: the physics, the tasks and their rendering."""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
