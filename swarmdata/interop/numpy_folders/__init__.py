"""NumPy folders, as in OMAR and CFCQL."""
