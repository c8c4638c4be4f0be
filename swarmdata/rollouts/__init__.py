"""Policies in worlds: rollouts, evaluation, and what is measured of an episode."""
