"""Training rewards: costs and potentials added to the task's reward."""
