"""Every algorithm that values actions improves on its data."""

from pathlib import Path
from typing import Any

import pytest

from swarmdata.learn.training.trainer import train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from tests.offline_algos.toys import (
    progress_of,
    share_by_the_sign,
    sign_at_the_start,
    step_of,
    trained,
)
from tests.support.memory_dataset import MemoryDataset

pytestmark = pytest.mark.learns

LONG = {"batch_size": 256}
WARM = {"bc_warmup_share": 0.2, **LONG}
PENALIZED = {
    "critic_learning_rate": 1e-3, "bc_warmup_share": 0.25, "n_samples": 4, "bc_weight": 0.0
}  # fmt: skip
FLOW = {"flow_hidden": (64, 64), "inverse_temperature": 6.0}
CASES: list[tuple[str, int, dict[str, Any], float]] = [
    *(
        (name, 500, {"regulariser": regulariser}, 0.08)
        for name in ("vdn", "qmix")
        for regulariser in ("bc", "bcq", "cql")
    ),
    *((name, 800, PENALIZED, 0.08) for name in ("maddpg_cql", "cfcql", "icql_qs")),
    ("omar", 800, {**PENALIZED, "bc_weight": 1.5}, 0.08),
    *(("facmac_bc", 1500, {"mixer": m, **WARM}, 0.08) for m in ("monotonic", "free")),
    *(
        # the paper's weight: half of these data are worth leaving
        ("maddpg_bc", 1500, {"extraction": "joint", "joint_gradient": g, **WARM}, 0.08)
        for g in ("all", "own")
    ),
    ("matd3", 1500, WARM, 0.08),
    ("iql", 1500, LONG, 0.07),
    ("iql_cost", 1500, LONG, 0.07),
    ("omiga", 1500, LONG, 0.07),
    *(
        ("mac_flow", 1000, {"reward": reward, "mixer": mixer, **FLOW}, 0.08)
        for reward, mixer in (("own", "mean"), ("team", "mean"), ("team", "monotonic"))
    ),
]  # fmt: skip


@pytest.mark.parametrize(("name", "n_updates", "settings", "least"), CASES)
def test_it_improves_on_a_mixture(
    mixture: MemoryDataset, name: str, n_updates: int, settings: dict[str, Any], least: float
) -> None:
    """Half of the data drive at the goal, the other half at random.

    Progress of a step: 0.03 for the data, 0.045 for a clone of them, 0.16 for driving straight.
    """
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, name)
    algorithm: Any = trained(kind, mixture, n_updates, **settings)[0]
    observations = mixture.transitions["observations"][:1500]
    step = step_of(len(observations))._replace(observations=observations)
    for index in range(2):
        assert progress_of(algorithm.policy(index).act(step), observations) > least


def test_without_values_a_flow_is_a_clone(mixture: MemoryDataset) -> None:
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, "mac_flow")
    settings: dict[str, Any] = {**FLOW, "inverse_temperature": 0.0}
    algorithm: Any = trained(kind, mixture, 1000, **settings)[0]
    observations = mixture.transitions["observations"][:1500]
    step = step_of(len(observations))._replace(observations=observations)
    assert progress_of(algorithm.policy(0).act(step), observations) < 0.07


@pytest.mark.parametrize("memory", ["gru", "none"])
@pytest.mark.parametrize(
    ("name", "layers"),
    [("bc", ("hidden",)), ("mac_flow", ("actor_hidden", "critic_hidden", "flow_hidden"))],
)
def test_it_does_what_only_a_memory_knows(
    name: str, layers: tuple[str, ...], memory: str, tmp_path: Path
) -> None:
    """Drives by a sign of 11 steps before; the flow reads it from the state. Others guess."""
    config = resolve("algorithm", OFFLINE_ALGORITHMS, name).Config(
        n_updates=600, batch_size=128, memory=memory, memory_size=16, burn_in=10, window=12,
        **dict.fromkeys(layers, (32,)),
    )  # fmt: skip
    data = sign_at_the_start(200, 0)
    (policy,) = train_seeds(name, data, tmp_path, seeds=(0,), config=config, progress=False)
    right = share_by_the_sign(policy)
    assert (right > 0.9) if memory == "gru" else (0.3 < right < 0.7)
