"""Integrity of stored datasets: checksums, damage, recognition, recovery of a manifest."""
