"""Entries of a leaderboard: policies in a folder, which anybody can evaluate again."""
