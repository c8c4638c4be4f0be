"""Policies for robots: one network that any runtime of ONNX runs, without this package."""
