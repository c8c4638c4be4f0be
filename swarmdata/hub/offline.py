"""Whether the environment keeps this process from using the network."""

import os

OFFLINE_VARIABLES = ("SWARMDATA_OFFLINE", "HF_HUB_OFFLINE")
"""Variables of the environment that keep `load` from asking remotes."""


def offline_variable() -> str | None:
    """The first of `OFFLINE_VARIABLES` that is set to 1, on, yes or true; None: none is."""
    words = {name: os.environ.get(name, "").strip().upper() for name in OFFLINE_VARIABLES}
    return next((name for name in words if words[name] in ("1", "ON", "YES", "TRUE")), None)
