"""Metadata for search engines and viewers: an episode table, Croissant, the hub's card."""

from swarmdata.hub.publishing.metadata.hub_files import hub_card, metadata_files, write_beside

__all__ = ["hub_card", "metadata_files", "write_beside"]
