"""Training runs: how they are started, and which policies they keep."""
