"""A study: a grid of algorithms, datasets and seeds, from one file to tables and figures."""
