"""What others need to find and show a dataset: an episode table, Croissant, the hub's card."""
