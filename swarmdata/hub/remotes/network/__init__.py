"""Connections that are retried, interrupted and abandoned when they are too slow."""
