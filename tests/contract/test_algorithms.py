"""Every registered offline algorithm keeps the contract."""

from collections.abc import Callable, Sequence
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.learn.memory.memory_settings import WindowSettings  # noqa: E402
from swarmdata.learn.policies.policy_file import load_policy, save_policy  # noqa: E402
from swarmdata.registry.components import (  # noqa: E402
    DISCRETE_ALGORITHMS,
    OFFLINE_ALGORITHMS,
    resolve,
)
from swarmdata.testing.algorithm_contract import check_algorithm  # noqa: E402
from swarmdata.testing.sample_batches import sample_batch as draw  # noqa: E402
from swarmdata.testing.sample_batches import sample_setup  # noqa: E402
from swarmdata.testing.sample_batches import sample_step as step  # noqa: E402
from swarmdata.types import Batch, Step  # noqa: E402
from tests.support.pairs import once_each  # noqa: E402

Draw = Callable[[Sequence[int], int], Batch]

MEMORY: dict[str, Any] = {"memory": "gru", "memory_size": 8, "burn_in": 1, "window": 3}
TWO: dict[str, Any] = {"actor_hidden": (32, 32), "critic_hidden": (32, 32), "n_updates": 200}
ACTOR_CRITIC = {**TWO, "bc_warmup_share": 0.01}
FLOW: dict[str, Any] = {"flow_hidden": (32, 32), "n_flow_steps": 3, "n_updates": 200}
ONE: dict[str, Any] = {"hidden": (32, 32), "n_updates": 200}
SMALL: dict[str, dict[str, Any]] = {
    "bc": ONE,
    "filtered_bc": ONE,
    "bc_flow": {**ONE, **FLOW},
    "bc_latent": ONE,
    "mac_flow": {**TWO, **FLOW},
    "facmac_bc": ACTOR_CRITIC,
    "iql": TWO,
    "iql_cost": TWO,
    "omiga": TWO,
    "oryx": {"width": 16, "value_hidden": (16,), "n_updates": 200, "burn_in": 1, "window": 3},
    "maddpg_bc": ACTOR_CRITIC,
    "matd3": ACTOR_CRITIC,
    "maddpg_cql": {**ACTOR_CRITIC, "n_samples": 2},
    "cfcql": {**ACTOR_CRITIC, "n_samples": 4},
    "icql_qs": {**ACTOR_CRITIC, "n_samples": 4},
    "omar": {**ACTOR_CRITIC, "n_samples": 2, "n_candidates": 4},
    "vdn": ONE,
    "qmix": {**ONE, "mixer_hidden": 16},
}


def in_windows(draw: Draw, seeds: Sequence[int], index: int) -> Batch:
    """What `draw` gives, as 4 windows of 4 steps: one begins with padding, one ends with it."""
    batch = draw(seeds, index)
    columns = {f.name: getattr(batch, f.name) for f in fields(batch)}
    values = {k: None if v is None else v.unflatten(1, (4, 4)) for k, v in columns.items()}
    windows = Batch(**values)
    windows.mask[:, 0, :1] = windows.mask[:, 1, 3:] = False
    return windows


def batches_of(config: Any) -> Draw:
    """Batches as the trainer draws them: windows for policies with a memory."""
    has_windows = isinstance(config, WindowSettings) and config.has_memory
    return partial(in_windows, draw) if has_windows else draw


CHOICES = ((range(4), range(2)), (range(1, 4),), (range(4), range(2)))
"""Of robots that differ: the second has one column, with choices from 1 to 3."""


def draw_choices(seeds: Sequence[int], index: int) -> Batch:
    """As `draw`, with choices for actions."""
    batch = draw(seeds, index)
    first = torch.tensor([[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]])
    number = torch.tensor([[4.0, 2.0], [3.0, 1.0], [4.0, 2.0]])
    chosen = ((batch.actions + 1) / 2 * number).floor().minimum(number - 1) + first
    return replace(batch, actions=chosen, next_actions=None)


@pytest.mark.parametrize(("name", "memory"), once_each(tuple(DISCRETE_ALGORITHMS), ("none", "gru")))
def test_algorithms_of_choices_keep_the_contract(name: str, memory: str) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL[name], **({} if memory == "none" else MEMORY))

    def build(seeds: Sequence[int]) -> Any:
        setup = sample_setup(seeds)
        return kind(replace(setup, sizes=replace(setup.sizes, choices=CHOICES)), config)

    batches = draw_choices if memory == "none" else partial(in_windows, draw_choices)
    many = Step._make(np.concatenate([each] * 60) for each in step())
    rng = np.random.default_rng(3)
    many = many._replace(observations=rng.normal(size=many.observations.shape).astype("f4"))
    check_algorithm(build, batches, many, n_updates=6, tolerance=0.0, are_choices=True)


@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
@pytest.mark.parametrize("memory", ["none", "gru"])
def test_its_policies_can_be_copied_into_a_dataset(name: str, memory: str, tmp_path: Path) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    if memory != "none" and not hasattr(kind.Config(), "memory"):
        return
    settings = {} if memory == "none" else {"memory": memory, "memory_size": 8}
    config = kind.Config(**SMALL.get(name, {}), **settings)
    policy = kind(sample_setup((3, 1)), config).policy(1)
    save_policy(tmp_path / "policy.safetensors", policy)
    read = load_policy(tmp_path / "policy.safetensors")
    for each in (policy, read):
        each.reset(step(), np.arange(len(step().seeds)))
    np.testing.assert_array_equal(read.act(step()), policy.act(step()))


SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("maddpg_bc", {"joint_gradient": "own"}),
    ("vdn", {"independent": True}),
    ("vdn", {**MEMORY, "regulariser": "cql", "parameters": "separate"}),
)
OTHER_SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("vdn", {"regulariser": "bc", "behavior_head": "joint"}),
    ("mac_flow", {**MEMORY, "noise": "own", "reward": "team", "n_updates": 20}),
    ("oryx", {"joint": False}),
    ("mac_flow", {"reward": "team", "mixer": "free", "mixer_hidden": 16}),
    ("mac_flow", {"noise": "own", "redraw": "episode"}),
    ("vdn", {"regulariser": "none", "parameters": "separate"}),
    ("qmix", {"regulariser": "bcq"}),
    ("bc", MEMORY),
    ("iql", MEMORY),
    ("bc_flow", MEMORY),
    ("qmix", {**MEMORY, "regulariser": "bcq"}),
    ("oryx", {"reward": "team", "n_components": 1, "n_heads": 2}),
)


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        *((name, {}) for name in OFFLINE_ALGORITHMS),
        *SETTINGS,
        *(pytest.param(*each, marks=pytest.mark.slow) for each in OTHER_SETTINGS),
    ],
)
def test_the_algorithm_keeps_the_contract(name: str, changes: dict[str, Any]) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**{**SMALL.get(name, {}), **changes})
    check_algorithm(kind, batches_of(config), config=config, n_updates=6, tolerance=0.0)


@pytest.mark.gpu
@pytest.mark.parametrize("name", OFFLINE_ALGORITHMS)
def test_what_a_gpu_learns_acts_the_same_on_a_cpu(name: str) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    config = kind.Config(**SMALL.get(name, {}))
    learner = kind(replace(sample_setup((0,)), device="cuda"), config)
    for index in range(6):
        batch = batches_of(config)((0,), index)
        columns = {each.name: getattr(batch, each.name) for each in fields(batch)}
        moved = {k: v if v is None else v.to("cuda") for k, v in columns.items()}
        losses = learner.update(Batch(**moved))
        assert all(torch.isfinite(each).all() for each in losses.values())
    resumed = kind(sample_setup((0,)), config)
    resumed.load_state_dict({k: v.cpu() for k, v in learner.state_dict().items()})
    acts = []
    for policy in (learner.policy(0), resumed.policy(0)):
        policy.reset(step(), np.arange(len(step().seeds)))
        acts.append(policy.act(step()))
    np.testing.assert_array_equal(*acts)
