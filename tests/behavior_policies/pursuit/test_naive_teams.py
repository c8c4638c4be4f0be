"""Teams whose robots each chase the nearest evader differ in how far they aim ahead."""

import numpy as np
import pytest

from swarmdata.envs.pursuit.pursuit_rules import PursuitRules
from swarmdata.errors import SpecError
from swarmdata.registry.components import make_env, make_policy
from swarmdata.registry.presets import preset
from swarmdata.types import Float

SPEC = preset("pursuit")


def actions_of(name: str) -> Float:
    """After a second, in which the evader has begun to wander."""
    env, policy = make_env(SPEC, 8), make_policy(name, SPEC)
    step = env.reset(np.arange(8, dtype=np.uint64))
    for _ in range(10):
        step = env.step(np.zeros((8, 3, 2)))
    policy.reset(step, np.arange(8))
    return policy.act(step)


def test_every_naive_team_aims_elsewhere() -> None:
    found = {name: actions_of(name) for name in PursuitRules.naive_teams}
    assert len({actions.tobytes() for actions in found.values()}) == 4
    mixed = found["pursuit-lead-mixed"]  # reciprocal avoidance depends on the others' aims a little
    for i, name in enumerate(("pursuit-greedy", "pursuit-lead-1", "pursuit-lead-3")):
        np.testing.assert_allclose(mixed[:, i], found[name][:, i], atol=0.5)


def test_they_are_of_one_task() -> None:
    with pytest.raises(SpecError, match="expected 'pursuit'"):
        make_policy("pursuit-greedy", preset("search"))
