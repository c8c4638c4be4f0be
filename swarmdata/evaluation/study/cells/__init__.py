"""The cells of a study: one algorithm on one dataset, each in a process of its own."""
