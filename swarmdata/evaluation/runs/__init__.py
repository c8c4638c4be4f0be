"""Training runs: how they are started, and the provenance of their policies."""
