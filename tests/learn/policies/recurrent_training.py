"""Small recurrent algorithms after a few updates on windows, and steps to act on."""

from typing import Any

import numpy as np

from swarmdata.datasets.dataset import Dataset
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.setup import Setup, Sizes
from swarmdata.learn.training.training_data import framed
from swarmdata.offline_algos.bc import BC, BCConfig
from swarmdata.offline_algos.mac_flow import MACFlow, MACFlowConfig
from swarmdata.offline_algos.oryx import Oryx, OryxConfig
from swarmdata.perception.frames import Frame
from swarmdata.types import Float, Step

MEMORY: dict[str, Any] = {"memory": "gru", "memory_size": 6, "burn_in": 2, "window": 4}
FLOW: dict[str, Any] = {
    **MEMORY, "actor_hidden": (8,), "critic_hidden": (8,), "flow_hidden": (8,), "n_flow_steps": 2,
    "n_updates": 6,
}  # fmt: skip
ORDER: dict[str, Any] = {
    "width": 16, "value_hidden": (8,), "burn_in": 2, "window": 4, "n_components": 2,
}  # fmt: skip


def trained(kind: Any, config: Any, data: Dataset, frame: Frame | None, n_updates: int = 5) -> Any:
    """An algorithm after some updates on windows."""
    seen = framed(data, frame)
    sampler = seen.sampler(4, horizon=config.window, burn_in=config.burn_in, seed=0)
    batch = sampler.gather(sampler.draw()[None]).to_torch()
    observation, action, state = (
        getattr(batch, name).shape[-1] for name in ("observations", "actions", "states")
    )
    sizes = Sizes(batch.actions.shape[-2], observation, action, state, frame=frame)
    algorithm = kind(Setup(sizes, [0], Statistics.measure(seen, config.discount)), config)
    for _ in range(n_updates):
        algorithm.update(sampler.gather(sampler.draw()[None]).to_torch())
    return algorithm


def bc(data: Dataset, frame: Frame | None = None, **changes: Any) -> BC:
    """A clone with a memory: its policy is a `RecurrentPolicy`."""
    config = BCConfig(**{"hidden": (8,), "learning_rate": 0.03, **MEMORY, **changes})
    algorithm: BC = trained(BC, config, data, frame)
    return algorithm


def mac_flow(data: Dataset, frame: Frame | None = None, **changes: Any) -> MACFlow:
    """After all updates of both stages; its policy is a `RecurrentFlowPolicy`."""
    config = MACFlowConfig(**{**FLOW, **changes})
    algorithm: MACFlow = trained(MACFlow, config, data, frame, config.n_updates)
    return algorithm


def oryx(data: Dataset, frame: Frame | None = None, **changes: Any) -> Oryx:
    """Robots that decide in order: its policy is a `SequencePolicy`."""
    config = OryxConfig(**{**ORDER, "learning_rate": 0.03, **changes})
    algorithm: Oryx = trained(Oryx, config, data, frame)
    return algorithm


def played(policy: Any, steps: list[Step]) -> Float:
    """Actions of an episode, [T, N, A]."""
    policy.reset(steps[0], np.arange(1))
    return np.concatenate([policy.act(step) for step in steps])


def steps_of(observations: Float, like: Step) -> list[Step]:
    """The steps of an episode that shows one copy these observations, [T, N, O]."""
    one = Step._make(field[:1] for field in like)
    return [
        one._replace(observations=row[None].copy(), times=np.full(1, time))
        for time, row in enumerate(observations)
    ]
