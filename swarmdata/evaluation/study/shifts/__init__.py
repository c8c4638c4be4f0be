"""Policies of a study in other conditions than those of their training."""
