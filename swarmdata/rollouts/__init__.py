"""Running policies in environments: rollouts, evaluation, metrics and score statistics."""
