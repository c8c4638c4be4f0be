"""Remotes: where datasets come from and go to, behind one small interface.

A remote finds a dataset by its exact id, gives single files and takes whole datasets. What this
side checks, resumes and renames is the same for all of them: `pull_dataset` and `release_files`.
"""
