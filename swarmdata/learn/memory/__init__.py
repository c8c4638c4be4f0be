"""Recurrent policies: what they are trained on, their networks, and how they act."""
