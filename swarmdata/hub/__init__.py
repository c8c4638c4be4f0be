"""Datasets by name: the catalog, remotes, and publishing."""
