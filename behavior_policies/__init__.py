"""Policies that produce datasets: scripted controllers and shipped checkpoints.

Kernels here compute with float64 `+ - * /`, `sqrt` and tables only, so that the bits are the same
on every platform. What their arguments mean is in `envs`, where nothing else is said.
"""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
