"""Networks of many seeds at once, their inputs, and their optimizer."""
