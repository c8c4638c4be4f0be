"""Observation models: what robots sense in a state.

The live environment and the reobservation of recorded data use the same `Sensor`.
"""

from swarmdata.perception.sensing.sensor import Sensor

__all__ = ["Sensor"]
