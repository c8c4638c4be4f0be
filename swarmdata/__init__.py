"""Offline multi-agent RL datasets for multi-robot tasks."""

__version__ = "0.1.0"
