"""The radio channel between the robots of a team."""
