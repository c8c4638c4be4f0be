"""The world of all tasks: stepping, episodes' layouts, rewards, and PettingZoo's interface."""
