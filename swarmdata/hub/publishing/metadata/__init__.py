"""Metadata for search engines and viewers: an episode table, Croissant, the hub's card."""
