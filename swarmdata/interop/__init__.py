"""Conversion of datasets to foreign formats and back, one file or folder for each format."""
