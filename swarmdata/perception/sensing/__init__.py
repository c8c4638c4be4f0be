"""Observation models: the sensors of the robots.

The live environment and the reobservation of recorded data use the same `Sensor`.
"""

from swarmdata.perception.sensing.sensor import Sensor

__all__ = ["Sensor"]
