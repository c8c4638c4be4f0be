"""The scripted controller of `transport`."""
