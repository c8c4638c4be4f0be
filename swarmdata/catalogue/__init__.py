"""The catalogue: static pages on which every dataset, episode and result can be looked at."""
