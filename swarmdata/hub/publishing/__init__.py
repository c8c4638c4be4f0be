"""Publishing: the checks before a push, and the metadata beside a dataset."""
