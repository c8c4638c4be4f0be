"""The scripted controller of `intersection`."""
