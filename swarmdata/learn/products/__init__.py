"""Matrix products of stacked networks."""
