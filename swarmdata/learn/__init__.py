"""The torch toolbox shared by the algorithms: stacked networks, optimizers, targets, runs."""
