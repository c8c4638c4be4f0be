"""What robots see and hear: sensors, radios, frames, and the pipeline of both."""
