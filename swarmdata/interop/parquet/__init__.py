"""Parquet files for Hugging Face `datasets`."""
