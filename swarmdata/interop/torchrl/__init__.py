"""TorchRL's memory-mapped TensorDicts."""
