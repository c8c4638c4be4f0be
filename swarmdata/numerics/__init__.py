"""Computations with the same bits on every machine: random streams, exact functions, geometry."""
