"""How datasets are made: from recipes, and from episodes of other datasets."""
