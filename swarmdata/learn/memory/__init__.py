"""Networks that remember, and the segments of episodes that they are trained on."""
