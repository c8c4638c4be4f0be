"""Copies of a task are an environment of TorchRL, and show what the vectorised environment does."""

from typing import Any

import numpy as np
import pytest

import swarmdata
from swarmdata.errors import SpecError
from swarmdata.numerics.random import EVALUATION_BASE

pytest.importorskip("torchrl", reason="the extra 'torchrl'")
torch = pytest.importorskip("torch", reason="the extra 'torch'")
pytestmark = [
    pytest.mark.slow,  # importing TorchRL takes seconds
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),  # TorchRL's own
]

COPIES, STEPS = 3, 8
SPEC = swarmdata.preset("coop_nav").model_copy(update={"horizon": 5})


def world(seed: int = 7) -> Any:
    return swarmdata.make_torchrl_env(SPEC, COPIES, seed=seed)


def play(env: Any, seed: int = 0) -> Any:
    from tensordict.nn import TensorDictModule

    generator = torch.Generator().manual_seed(seed)

    def act(observations: Any) -> Any:
        return 2 * torch.rand((*observations.shape[:2], 2), generator=generator) - 1

    keys = [("agents", "observation")], [("agents", "action")]
    policy = TensorDictModule(act, in_keys=keys[0], out_keys=keys[1])
    return env.rollout(STEPS, policy, break_when_any_done=False)


def test_it_is_what_its_specs_say() -> None:
    from torchrl.envs.utils import check_env_specs

    check_env_specs(world())


def test_a_rollout_is_that_of_the_vectorised_environment() -> None:
    env = world()
    rows = play(env)
    ours = swarmdata.make_env(SPEC, COPIES)
    first = rows["state"][:, 0].numpy()
    assert env._n_begun == 2 * COPIES, "each copy began a second episode after the horizon"
    begun = world()._draw(COPIES)
    assert (begun < np.uint64(EVALUATION_BASE)).all()
    step = ours.reset(begun)
    np.testing.assert_array_equal(step.states, first)
    for t in range(SPEC.horizon):
        step = ours.step(rows["agents", "action"][:, t].numpy())
        after = rows["next"][:, t]
        np.testing.assert_array_equal(after["agents", "observation"].numpy(), step.observations)
        np.testing.assert_array_equal(after["agents", "reward"][..., 0].numpy(), step.rewards)
        np.testing.assert_array_equal(after["agents", "events"].numpy(), step.events)
        np.testing.assert_array_equal(after["state"].numpy(), step.states)
        np.testing.assert_array_equal(after["truncated"][:, 0].numpy(), step.truncations)
    assert step.truncations.all()
    last, new = rows["next", "state"][:, SPEC.horizon - 1], rows["state"][:, SPEC.horizon]
    assert (last != new).any(dim=1).all(), "the last state before a reset is kept"


def test_the_seed_determines_everything() -> None:
    one, other = world(), world(8)
    rows = play(one)
    assert (play(other)["state"] != rows["state"]).any()
    other.set_seed(7)
    assert (play(other)["state"] == rows["state"]).all()


def test_copies_are_reset_one_by_one() -> None:
    from tensordict import TensorDict

    env = world()
    before = env.reset()
    mask = torch.tensor([[True], [False], [False]])
    after = env.reset(TensorDict({**before, "_reset": mask}, before.batch_size))
    same = (after["state"] == before["state"]).all(dim=1)
    assert same.tolist() == [False, True, True]


def test_no_copies_are_refused() -> None:
    with pytest.raises(SpecError, match="n_copies is 0"):
        swarmdata.make_torchrl_env(SPEC, 0)
