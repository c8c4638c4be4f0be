"""Small SVG drawings for the pages: an episode, estimates with intervals, lines with bands."""
