"""A study: a grid of algorithms, datasets and seeds, from one file to tables and figures.

`plan` is the file, `cells` has the cells that it asks for and runs each in its own process,
`run_study` runs all of them, and `pages` writes the tables and figures.
"""
