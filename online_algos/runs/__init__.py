"""Runs of online training, and how their policies get into the package."""
