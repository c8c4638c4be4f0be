"""The process and the machine: compiled kernels, workers, locks, safe files."""
