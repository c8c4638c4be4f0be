"""What happens before a dataset is published, and the metadata that goes with it."""
