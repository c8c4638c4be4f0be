"""Actors that start from another run are its actors; what cannot be a start is refused."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from torch import Tensor

from swarmdata.behavior_policies.learned import Learned
from swarmdata.errors import BuildError, CheckpointError, SpecError
from swarmdata.interfaces import OnlineAlgorithm
from swarmdata.learn.policies.policy_file import save_policy
from swarmdata.learn.training.run_files import policy_path
from swarmdata.online_algos.imitation.teacher_cloning import CloneConfig, clone_teacher
from swarmdata.online_algos.maddpg import MADDPG, MADDPGConfig
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.online_algos.ppo import initial_weights as module
from swarmdata.online_algos.ppo.initial_weights import StartConfig, initial_weights
from swarmdata.registry.components import make_env
from swarmdata.registry.recipes import FAMILY_SPECS, checkpoints
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Step

SPEC = TaskSpec(horizon=20)
SMALL = MAPPOConfig(n_steps=1024, n_copies=2, rollout_steps=8, hidden=8, minibatch=64)


def made(seeds: tuple[int, ...], config: MAPPOConfig = SMALL) -> MAPPO:
    return MAPPO(make_env(SPEC, config.n_copies * len(seeds)), seeds, config)


def saved(run: OnlineAlgorithm, seeds: tuple[int, ...], folder: Path) -> Path:
    """A folder with policies of two checkpoints for each seed."""
    for frames in (16, 32):
        run.update()
        for index, seed in enumerate(seeds):
            save_policy(policy_path(folder, seed, frames), run.policy(index))
    return folder


def some_step() -> Step:
    return make_env(SPEC, 5).reset(np.arange(5, dtype=np.uint64))


@pytest.mark.parametrize("parameters", ["shared", "separate"])
@pytest.mark.parametrize("folders", ["", "seeds-3-7"])
def test_each_seed_starts_from_its_own_last_policy(
    tmp_path: Path, parameters: str, folders: str
) -> None:
    config = replace(SMALL, parameters=parameters)  # type: ignore[arg-type]
    first = made((3, 7), config)
    saved(first, (3, 7), tmp_path / folders)
    second = made((7, 3), replace(config, start=StartConfig(policies=str(tmp_path))))
    step = some_step()
    assert not np.array_equal(second.policy(0).act(step), first.policy(1).act(step))
    second.prepare()
    for ours, theirs in ((0, 1), (1, 0)):
        np.testing.assert_allclose(
            second.policy(ours).act(step), first.policy(theirs).act(step), atol=1e-6
        )
    second.update()  # goes on from there


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frame": "world"}, "expected shared ones in None"),
        ({"parameters": "separate"}, "holds shared actors in frame"),
        ({"hidden": 16}, "weights have shapes"),
    ],
)
def test_other_actors_are_refused(tmp_path: Path, changes: dict[str, str], message: str) -> None:
    saved(made((0,)), (0,), tmp_path)
    run = made((0,), replace(SMALL, start=StartConfig(policies=str(tmp_path)), **changes))  # type: ignore[arg-type]
    before = run.actors.network.flat.clone()
    with pytest.raises(CheckpointError, match=message):
        run.prepare()
    assert (run.actors.network.flat == before).all()


def test_squashed_actors_of_the_same_sizes_are_refused(tmp_path: Path) -> None:
    config = MADDPGConfig(
        n_steps=100, n_copies=2, rollout_steps=4, batch_size=4, capacity=20, margin=20,
        warmup_transitions=0, actor_hidden=(8, 8), critic_hidden=(8,),
    )  # fmt: skip
    saved(MADDPG(make_env(SPEC, 2), (0,), config, tmp_path / "replay"), (0,), tmp_path / "run")
    run = made((0,), replace(SMALL, start=StartConfig(policies=str(tmp_path / "run"))))
    with pytest.raises(CheckpointError, match="another algorithm"):
        run.prepare()


def test_a_shipped_tier_is_a_start() -> None:
    """As rounded as its checkpoint: its actions differ by the rounding of activations only."""
    config = replace(SMALL, hidden=128, start=StartConfig(policies="coop_nav-expert"))
    env = make_env(FAMILY_SPECS["coop_nav"], 2 * config.n_copies)
    run = MAPPO(env, (2, 0), config)
    run.prepare()
    step = make_env(FAMILY_SPECS["coop_nav"], 5).reset(np.arange(5, dtype=np.uint64))
    for index, seed in enumerate((2, 0)):
        shipped = checkpoints("coop_nav", "expert")[seed]
        learned = Learned(FAMILY_SPECS["coop_nav"], checkpoint=shipped.file, sha256=shipped.sha256)
        np.testing.assert_allclose(run.policy(index).act(step), learned.act(step), atol=0.01)


@pytest.mark.parametrize(
    ("start", "error", "message"),
    [
        ({"policies": "coop_nav-expert"}, BuildError, "seed 4 .* coop_nav-expert ships 4"),
        ({"avoidance": True}, SpecError, r"nothing to clone.*start\.policies=RUN"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_start_is_refused(
    start: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        made((0, 4), replace(SMALL, start=StartConfig(**start))).prepare()


def test_a_seed_that_the_other_run_lacks_is_an_error(tmp_path: Path) -> None:
    saved(made((0,)), (0,), tmp_path)
    with pytest.raises(BuildError, match="no policy of seed 1"):
        made((0, 1), replace(SMALL, start=StartConfig(policies=str(tmp_path)))).prepare()


def test_the_weights_are_returned_and_the_actors_left_alone(tmp_path: Path) -> None:
    saved(made((0,)), (0,), tmp_path)
    run = made((0,))
    before = run.actors.copy()
    start = StartConfig(policies=str(tmp_path), teacher="straight", clone_rounds=1)
    found = initial_weights(start, run.actors, run.worlds, run.generators, run.seeds)
    for left, own in ((before.network.flat, run.actors.network.flat),
                      (before.input_mean, run.actors.input_mean)):  # fmt: skip
        np.testing.assert_array_equal(left, own)
    assert not (found.network.flat == before.network.flat).all()


def test_rounds_of_cloning_are_as_many_and_as_long_as_set(monkeypatch: pytest.MonkeyPatch) -> None:
    configs: list[CloneConfig] = []

    def watch(*arguments: Any) -> list[Tensor]:
        configs.append(arguments[-1])
        return clone_teacher(*arguments)

    monkeypatch.setattr(module, "clone_teacher", watch)
    start = StartConfig(teacher="straight", clone_rounds=2, clone_steps=12, clone_noise=0.02)
    made((0,), replace(SMALL, start=start)).prepare()
    assert configs == [CloneConfig(n_rounds=2, rollout_steps=12, noise=0.02)]
