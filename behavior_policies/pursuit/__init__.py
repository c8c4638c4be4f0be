"""The scripted controllers of `pursuit`: a team that surrounds, and teams that chase."""
