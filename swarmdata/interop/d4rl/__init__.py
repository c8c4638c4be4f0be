"""D4RL-style HDF5 files."""
