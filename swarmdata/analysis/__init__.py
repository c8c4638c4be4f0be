"""What recorded states show: coverage, visits, passings, entropy."""
