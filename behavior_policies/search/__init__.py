"""The scripted controller of `search`."""
