"""A study: a grid of algorithms, datasets and seeds, from one file to tables, figures and text.

`plan` is the file, `cells` what it asks for, `working` does one cell in a process of its own,
`running` all of them, `gathering` makes tidy tables of what is done, and `writing` the pages.
"""
