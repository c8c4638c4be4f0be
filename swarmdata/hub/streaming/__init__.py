"""Datasets that are read from a remote while they are used, in part and in bounded space."""
