"""RecurrentFlowPolicy acts as it was trained, by noise that can be scaled."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the toolbox needs torch")

from swarmdata.datasets.dataset import Dataset  # noqa: E402
from swarmdata.learn.policies.drawn_policy import RecurrentFlowPolicy  # noqa: E402
from swarmdata.learn.training.framed_dataset import framed  # noqa: E402
from swarmdata.perception.frames import Frame  # noqa: E402
from swarmdata.registry.components import make_env  # noqa: E402
from tests.learn.policies.recurrent_training import FLOW, mac_flow, steps_of  # noqa: E402


@pytest.mark.parametrize("in_frame", [False, True])
@pytest.mark.parametrize("settings", [{}, {"noise": "own", "redraw": "episode"}])
def test_acting_step_by_step_is_the_window_from_the_start(
    data: Dataset, frame: Frame, in_frame: bool, settings: dict[str, Any]
) -> None:
    used = frame if in_frame else None
    algorithm, observations = mac_flow(data, used, **settings), np.array(data[0].observations)
    sampler = framed(data, used).sampler(1, horizon=FLOW["window"], burn_in=8, seed=0)
    batch = sampler.gather(np.array([[8]])).to_torch()  # steps 0 to 11, of which 8 to 11 count
    policy = algorithm.policy(0)
    assert isinstance(policy, RecurrentFlowPolicy)
    steps = steps_of(observations[:12], make_env(data.task, 1).reset(np.zeros(1, "u8")))
    for _ in range(2):  # a reset makes every episode the first
        policy.reset(steps[0], np.arange(1))
        actions = np.concatenate([policy.act(step) for step in steps])[8:]
    noise = np.concatenate([policy.draw(step) for step in steps])[8:]
    assert (noise[0] == noise[1]).all() == ("redraw" in settings)
    actor = algorithm.copy.actor
    expected = actor(actor.see(batch).features, torch.from_numpy(noise[None]).float())
    wanted = expected[0].detach().numpy()
    if used is not None:
        wanted = used.to_world(observations[8:12], wanted).astype(np.float32)
        wanted /= np.maximum(np.linalg.norm(wanted, axis=-1, keepdims=True), 1)
    np.testing.assert_allclose(actions, wanted, atol=1e-5)


def test_noise_is_scaled(data: Dataset) -> None:
    policy = mac_flow(data).policy(0)
    assert isinstance(policy, RecurrentFlowPolicy)
    step = make_env(data.task, 2).reset(np.arange(2, dtype=np.uint64))
    quiet = replace(policy, noise_scale=0.25)
    np.testing.assert_array_equal(quiet.draw(step), 0.25 * policy.draw(step))
