"""Policy selection without a simulator."""
