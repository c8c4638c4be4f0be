"""The data files of the catalogue: which episodes it shows, and their arrays, packed."""
