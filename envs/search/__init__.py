"""The task `search`: robots find victims and rescue them together."""
