"""Trained policies, in memory and as files."""
