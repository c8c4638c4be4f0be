"""Actors of K teams that act by their means, and their samples: of MAPPO, DAgger and clones."""
