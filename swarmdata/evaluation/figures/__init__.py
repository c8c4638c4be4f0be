"""Figures of estimates: what they show comes in as numbers, names and looks."""
