"""The parts that all tasks share: stepping, layouts, rewards, and the PettingZoo interface."""
