"""Policies that produce datasets: scripted controllers and shipped checkpoints."""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
