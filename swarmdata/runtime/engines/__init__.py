"""Engines that do jobs: processes of this machine, Dask, SLURM, Ray, or an executor of the user."""
