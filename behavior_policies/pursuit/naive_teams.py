"""Teams of `pursuit` that do not act together: each robot chases the nearest evader that it knows.

They differ in how far ahead of the evader they aim.
"""

from typing import ClassVar

import numpy as np

from swarmdata.behavior_policies.pursuit.pursuit_controller import PursuitController
from swarmdata.specs.task_spec import TaskSpec

STRAIGHT, ONE_SECOND, THREE_SECONDS = (0.0, 0.0), (0.5, 1.0), (2.0, 3.0)
"""Share of the time to the evader, and largest time, s."""


class Greedy(PursuitController):
    """Every robot drives straight at the evader."""

    leads_in_turn: ClassVar[tuple[tuple[float, float], ...]] = (STRAIGHT,)

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        leads = [self.leads_in_turn[i % len(self.leads_in_turn)] for i in range(spec.n_agents)]
        super().__init__(spec, noise=noise, leads=np.array(leads))


class LeadOne(Greedy):
    """Every robot aims up to 1 s ahead of the evader."""

    leads_in_turn = (ONE_SECOND,)


class LeadThree(Greedy):
    """Every robot aims up to 3 s ahead of the evader."""

    leads_in_turn = (THREE_SECONDS,)


class LeadMixed(Greedy):
    """Robots aim 0 s, up to 1 s and up to 3 s ahead of the evader, in turn."""

    leads_in_turn = (STRAIGHT, ONE_SECOND, THREE_SECONDS)
