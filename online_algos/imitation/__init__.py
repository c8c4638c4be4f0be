"""Teachers, and actors that clone them."""
