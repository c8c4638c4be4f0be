"""FlowPolicy: its noise, its log-probabilities, its file."""

from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="policies of algorithms need torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.learn.flows.one_step_actor import OneStepActor  # noqa: E402
from swarmdata.learn.networks.sizes import Sizes  # noqa: E402
from swarmdata.learn.policies.flow_policy import FlowPolicy, Noise, Redraw  # noqa: E402
from swarmdata.learn.policies.policy_file import load_policy, save_policy  # noqa: E402
from swarmdata.learn.training.setup import Setup  # noqa: E402
from swarmdata.perception.frames import find_frame  # noqa: E402
from swarmdata.registry.components import make_env  # noqa: E402
from swarmdata.specs.task_spec import TaskSpec  # noqa: E402
from swarmdata.testing.policy_contract import check_policy  # noqa: E402
from swarmdata.types import Step  # noqa: E402
from tests.offline_algos.toys import SIZES, statistics, step_of  # noqa: E402

SPEC = TaskSpec.parse({"horizon": 12, "team": [{"count": 3}]})


def made(**changes: object) -> FlowPolicy:
    actor = OneStepActor(
        Setup(SIZES, (0, 1), statistics()), (16,), noise="team", redraw="step", scale=1.0
    )
    return replace(actor.policy(0), **changes)  # type: ignore[arg-type]


def driving(noise: Noise = "team", **changes: object) -> FlowPolicy:
    """An untrained policy of the task."""
    env = make_env(SPEC, 1)
    frame = find_frame(env.features, "target")
    assert frame is not None
    step = env.reset(np.zeros(1, np.uint64))
    n_features = frame.inputs(step.observations).shape[-1]
    sizes = Sizes(3, n_features, env.action_size, env.state_size, frame=frame)
    moments = replace(
        statistics(),
        observation_mean=np.zeros(n_features),
        observation_std=np.ones(n_features),
        state_mean=np.zeros(env.state_size),
        state_std=np.ones(env.state_size),
    )
    actor = OneStepActor(Setup(sizes, (0,), moments), (16,), noise=noise, redraw="step", scale=1.0)
    return replace(actor.policy(0), **changes)  # type: ignore[arg-type]


@pytest.mark.parametrize("noise", ["team", "own"])
@pytest.mark.parametrize("redraw", ["episode", "step"])
def test_it_keeps_the_contract_of_policies(noise: Noise, redraw: Redraw) -> None:
    check_policy(driving(noise, redraw=redraw), SPEC, make_env)


@pytest.mark.parametrize(("redraw", "stays"), [("episode", True), ("step", False)])
def test_noise_is_redrawn_when_it_should_be(redraw: str, stays: bool) -> None:
    policy = made(redraw=redraw)
    early, late = policy.draw(step_of(times=0)), policy.draw(step_of(times=9))
    assert np.array_equal(early, late) == stays
    assert len(np.unique(early)) == early.size  # episodes, robots and components have their own


def test_noise_is_a_function_of_the_seed_and_has_the_given_deviation() -> None:
    step = step_of(copies=2000)
    noise = made().draw(step)
    assert noise.std() == pytest.approx(1.0, abs=0.03)
    np.testing.assert_array_equal(made(noise_scale=0.25).draw(step), 0.25 * noise)
    reversed_step = Step._make(field[::-1] for field in step)
    np.testing.assert_array_equal(made().draw(reversed_step), noise[::-1])


def test_an_action_is_certain_given_the_noise() -> None:
    policy, step = made(), step_of()
    actions = policy.act(step)
    assert not policy.log_probs(step, actions).any()
    assert np.isneginf(policy.log_probs(step, actions * np.float32(0.5))).all()
    again = Step._make(step)  # another object: nothing is remembered of it
    assert not policy.log_probs(again, actions).any()


def test_it_comes_back_from_its_file_as_it_was(tmp_path: Path) -> None:
    policy = driving(redraw="episode", noise_scale=0.5)
    save_policy(tmp_path / "policy.safetensors", policy)
    read = load_policy(tmp_path / "policy.safetensors")
    assert isinstance(read, FlowPolicy)
    assert [f.name for f in fields(read)] == [f.name for f in fields(policy)]
    step = make_env(SPEC, 3).reset(np.arange(3, dtype=np.uint64))
    np.testing.assert_array_equal(read.act(step), policy.act(step))


def test_other_observations_are_refused() -> None:
    step = step_of()
    with pytest.raises(SchemaError, match="expected 3 features of 2 agents"):
        made().act(step._replace(observations=step.observations[..., :2]))
