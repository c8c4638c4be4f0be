"""The scripted controller of `warehouse`."""
