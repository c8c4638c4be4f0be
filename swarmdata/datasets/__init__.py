"""A dataset as users see it: subsets, samplers, re-observation."""
