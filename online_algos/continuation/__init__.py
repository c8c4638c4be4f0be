"""Online training that goes on from offline runs and with recorded data."""
