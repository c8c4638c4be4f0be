"""Discrete choices: bins of continuous actions, behavior heads, value decomposition."""
