"""A clone does as its teacher does, seed by seed."""

from dataclasses import replace

import numpy as np
import pytest
from torch import Tensor

from swarmdata.interfaces import Policy
from swarmdata.online_algos.actors.sample_rows import pick
from swarmdata.online_algos.imitation import teacher_cloning
from swarmdata.online_algos.imitation.teacher_cloning import CloneConfig, clone_teacher, collect
from swarmdata.online_algos.mappo import MAPPO, MAPPOConfig
from swarmdata.registry.components import make_env, make_policy
from swarmdata.specs.state_layout import VX, robots_of
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.testing.comparing import act_on
from swarmdata.types import Float, Int, Step
from tests.support.pairs import slow

SPEC = TaskSpec(horizon=20)
SMALL = MAPPOConfig(n_steps=1024, n_copies=4, rollout_steps=8, hidden=16, minibatch=64)
SHORT = CloneConfig(n_rounds=3, rollout_steps=32, n_passes=3, final_passes=2, minibatch=16)


def made(seeds: tuple[int, ...] = (0,), config: MAPPOConfig = SMALL) -> MAPPO:
    return MAPPO(make_env(SPEC, config.n_copies * len(seeds)), seeds, config)


def clone(run: MAPPO, teacher: Policy, config: CloneConfig) -> list[Tensor]:
    return clone_teacher(run.actors, run.worlds, run.generators, teacher, config)


@pytest.mark.parametrize("parameters", ["separate", *slow("shared")])
def test_a_clone_is_closer_to_its_teacher_than_it_was(parameters: str) -> None:
    run = made((0, 1), replace(SMALL, parameters=parameters))  # type: ignore[arg-type]
    teacher = make_policy("straight", SPEC)
    step = make_env(SPEC, 16).reset(np.arange(16, dtype=np.uint64))
    wanted = act_on(make_policy("straight", SPEC), step)

    def errors() -> list[float]:
        return [float(np.square(run.policy(k).act(step) - wanted).mean()) for k in (0, 1)]

    before = errors()
    losses = clone(run, teacher, SHORT)
    assert len(losses) == SHORT.n_rounds
    assert all(loss.shape == (2,) for loss in losses)
    assert (losses[-1] < losses[0]).all()
    assert all(ours < 0.7 * theirs for ours, theirs in zip(errors(), before, strict=True))


def test_only_actors_change() -> None:
    run = made()
    critic = run.critic.network.flat.clone()
    clone(run, make_policy("straight", SPEC), replace(SHORT, n_rounds=1))
    assert (run.critic.network.flat == critic).all()
    assert run.frames == 0


def test_episodes_longer_than_a_round_are_labelled_to_their_ends() -> None:
    labelled: list[int] = []

    class Watched:
        def reset(self, step: Step, copies: Int) -> None:
            pass

        def act(self, step: Step) -> Float:
            labelled.extend(step.times)
            return np.zeros((len(step.times), SPEC.n_agents, 2), np.float32)

    run = made()
    config = replace(SHORT, rollout_steps=SPEC.horizon // 2, n_rounds=3)
    clone_teacher(run.actors, run.worlds, run.generators, Watched(), config)
    assert set(labelled) == set(range(SPEC.horizon))


@pytest.mark.parametrize("teacher_acts", [True, False])
def test_the_teacher_acts_only_where_it_should(teacher_acts: bool) -> None:
    class Eastward:
        def reset(self, step: Step, copies: Int) -> None:
            pass

        def act(self, step: Step) -> Float:
            return np.tile(np.array([1, 0], np.float32), (len(step.times), SPEC.n_agents, 1))

    run = made(config=replace(SMALL, frame="world"))  # untrained: it hardly moves
    new = collect(
        run.actors, run.worlds, run.generators, Eastward(), 5, 0.0, teacher_acts=teacher_acts
    )
    speeds = robots_of(run.worlds.current_step.states, SPEC.n_agents)[..., VX]
    assert (speeds.mean() > 0.1) == teacher_acts
    assert (new[1] == new[1].new_tensor([1, 0])).all(), "labels are the teacher's either way"


def test_more_rounds_than_samples_allow_take_a_part_of_the_data_each(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    taken = []

    def count(samples: Tensor, rows: Tensor) -> Tensor:
        taken.append(rows.shape[1])
        return pick(samples, rows)

    monkeypatch.setattr(teacher_cloning, "pick", count)
    config = replace(SHORT, n_rounds=2, n_passes=3, max_samples=2000, final_passes=1)
    clone(made(), make_policy("straight", SPEC), config)
    each = SHORT.rollout_steps * SMALL.n_copies * SPEC.n_agents
    assert 3 * each < 2000 < 6 * each  # the second round's passes are cut short
    assert sum(taken) / 2 == 3 * each + 2000 + 2 * each  # inputs and labels of each
