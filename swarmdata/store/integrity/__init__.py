"""Whether a stored dataset is intact: checksums, damage, recognition, recovery of a manifest."""
