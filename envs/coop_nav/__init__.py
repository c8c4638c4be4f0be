"""Cooperative navigation."""
