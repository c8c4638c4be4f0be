"""Teams of `pursuit` that do not act together: each robot chases the nearest evader that it knows.

They see, remember, tell and search as the scripted team does. They differ in how far ahead of the
evader they aim: a share of the time that they need to where it is, and at most some seconds.
"""

import numpy as np

from swarmdata.behavior_policies.pursuit.pursuit_controller import PursuitController
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double

STRAIGHT, ONE_SECOND, THREE_SECONDS = (0.0, 0.0), (0.5, 1.0), (2.0, 3.0)
"""Share of the time to the evader, and largest time, s."""


def _leads(spec: TaskSpec, *leads: tuple[float, float]) -> Double:
    """Those of every robot, taken in turn, [N, 2]."""
    return np.array([leads[i % len(leads)] for i in range(spec.n_agents)])


class Greedy(PursuitController):
    """Every robot drives straight at the evader."""

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise=noise, leads=_leads(spec, STRAIGHT))


class LeadOne(PursuitController):
    """Every robot aims up to 1 s ahead of the evader."""

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise=noise, leads=_leads(spec, ONE_SECOND))


class LeadThree(PursuitController):
    """Every robot aims up to 3 s ahead of the evader."""

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise=noise, leads=_leads(spec, THREE_SECONDS))


class LeadMixed(PursuitController):
    """Robots aim 0 s, up to 1 s and up to 3 s ahead of the evader, in turn."""

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        super().__init__(spec, noise=noise, leads=_leads(spec, STRAIGHT, ONE_SECOND, THREE_SECONDS))
