"""Remotes: where datasets come from and go to, behind one small interface."""
