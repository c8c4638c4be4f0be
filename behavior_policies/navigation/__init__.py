"""Navigation of single robots: planning, reciprocal avoidance, velocity tracking."""
