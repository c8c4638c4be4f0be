"""Robustness: trained policies under worse communication and sensing."""
