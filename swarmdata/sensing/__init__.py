"""Observation models (in progress: only `state`)."""

import numpy as np

from swarmdata.features import Feature
from swarmdata.sensing.state import observe_states, state_observation_fields
from swarmdata.states import N_COLUMNS


class Sensor:
    def __init__(self, task, n_copies):
        m = task.spec.observation
        self.slots, self.reach = (m.n_neighbors, m.n_obstacles), m.range
        self.features = tuple(Feature(n, "position") for n in state_observation_fields(*self.slots))
        spec = task.spec
        self.radii = np.array([r.radius for r in spec.robots])
        self.half = np.array([spec.arena.width / 2, spec.arena.height / 2])
        self.gaps = np.zeros((n_copies, spec.n_agents))

    def forget(self, copies): ...

    def observe(self, now, active, out):
        observe_states(now.states, now.layouts, self.radii, self.half, self.slots, self.reach, active, out, self.gaps)
