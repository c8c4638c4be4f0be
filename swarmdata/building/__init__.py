"""Builders of datasets: from recipes, and from episodes of other datasets."""
