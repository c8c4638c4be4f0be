"""The arrays of a stored dataset: layout, attributes, row shapes, and how shards are written."""
