"""Analyses of recorded states and actions: coverage, visits, passings, entropy."""
