"""A dataset as users see it: views, samplers, reobservation."""
