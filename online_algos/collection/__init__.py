"""Data collection of online algorithms: worlds, replay, input normalization."""
