"""Training: the loop, run folders, checkpoints, data and replay."""
