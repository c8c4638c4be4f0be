"""The parts of PPO."""
