"""Perception: sensors, radios, frames, and the pipeline that makes observations of them."""
