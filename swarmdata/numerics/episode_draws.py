"""What an episode draws from the ranges of its spec: a pure function of its seed.

The draw of field k, the k-th of `randomization.RANDOM_FIELDS`, for robot i is

    low + (high - low) u    u = uniform(derive(seed, STREAMS["body"], k, i))

and low + floor((high - low + 1) u) for whole numbers. The only value of a field that robots do not
have each is that of robot 0.
"""

import numpy as np

from swarmdata.numerics.random import STREAMS, derive, uniform
from swarmdata.numerics.random_kernels import absorb, to_uniform
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.randomization import RANDOM_FIELDS, TEAM_RANGES
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Seeds

_STREAM = STREAMS["body"]

NOISE_FIELD, DROP_FIELD = RANDOM_FIELDS.index("noise"), RANDOM_FIELDS.index("drop_probability")
"""Fields that compiled code draws."""


@kernel(inline="always")
def draw_share(seed: np.uint64, field: int, robot: int) -> float:
    """Where in the range of a field an episode's draw is, in [0, 1)."""
    return to_uniform(absorb(absorb(absorb(seed, _STREAM), field), robot))


def draw(spec: TaskSpec, name: str, seeds: Seeds) -> Double:
    """Returns the values of a field of `RANDOM_FIELDS` in the episodes `seeds`, [E].

    They are [E, N]; of fields in `TEAM_RANGES`, [E, 1].
    """
    low, high = spec.randomization.ranges[name]
    n = 1 if name in TEAM_RANGES else spec.n_agents
    given = np.asarray(seeds, dtype=np.uint64)[:, None]
    shares = uniform(derive(given, _STREAM, RANDOM_FIELDS.index(name), np.arange(n)))
    if name == "command_delay":
        return low + np.floor((high - low + 1) * shares)
    return low + (high - low) * shares


def drawn_values(spec: TaskSpec, seeds: Seeds) -> dict[str, Double]:
    """Returns all that some episodes draw.

    Args:
        spec: of the episodes, such as `dataset.task`.
        seeds: of the episodes, [E].

    Returns:
        By field of `spec.randomization`, in the units of the spec: one value for each robot,
        [E, N]; of `drop_probability` and of the payload, one value, [E, 1]. Empty without
        randomization.
    """
    return {name: draw(spec, name, seeds) for name in spec.randomization.ranges}
