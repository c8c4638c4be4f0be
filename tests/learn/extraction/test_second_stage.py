"""The second stage of every actor-critic: what moves, what stands still, what is restored."""

from typing import Any, get_args

import pytest

torch = pytest.importorskip("torch", reason="algorithms need torch")

from swarmdata.errors import SchemaError  # noqa: E402
from swarmdata.learn.extraction.second_stage import Extraction, ExtractionConfig  # noqa: E402
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve  # noqa: E402
from tests.offline_algos.toys import made, random_batch  # noqa: E402

KINDS: dict[str, Any] = {
    name: resolve("algorithm", OFFLINE_ALGORITHMS, name) for name in OFFLINE_ALGORITHMS
}
TWO_STAGE = [name for name, kind in KINDS.items() if issubclass(kind.Config, ExtractionConfig)]
SECOND = [name for name in get_args(Extraction) if name != "joint"]


def trained(name: str, n_made: int, **settings: Any) -> Any:
    settings = {"n_updates": 8, "extraction_share": 0.5, **settings}
    algorithm = made(KINDS[name], 2, **settings)
    for _ in range(n_made):
        algorithm.update(random_batch(2))
    return algorithm


def test_every_actor_critic_has_it() -> None:
    expected = {"maddpg_bc", "facmac_bc", "maddpg_cql", "cfcql", "icql_qs", "omar"}
    assert set(TWO_STAGE) == expected


@pytest.mark.parametrize("extraction", SECOND)
@pytest.mark.parametrize("name", TWO_STAGE)
def test_with_frozen_critics_only_actors_move_in_it(name: str, extraction: str) -> None:
    algorithm = trained(name, 4, extraction=extraction, frozen_critics=True)
    before = {k: v.clone() for k, v in algorithm.state_dict().items()}
    losses = algorithm.update(random_batch(2))
    assert set(losses) == {"extraction_loss", "extracted_q"}
    after = algorithm.state_dict()
    moved = {k for k, v in before.items() if not torch.equal(v, after[k])}
    assert "actor" in moved
    assert not {k for k in moved if "critic" in k or "utilit" in k or "density" in k}


@pytest.mark.parametrize("name", TWO_STAGE)
def test_actors_and_critics_move_in_it(name: str) -> None:
    algorithm = trained(name, 4, extraction="anchored")
    before = {k: v.clone() for k, v in algorithm.state_dict().items()}
    losses = algorithm.update(random_batch(2))
    assert {"extraction_loss", "extracted_q", "critic_loss"} <= set(losses)
    after = algorithm.state_dict()
    moved = {k for k, v in before.items() if not torch.equal(v, after[k])}
    assert "actor" in moved
    assert any("critic" in k or "utilit" in k for k in moved)
    assert not any("density" in k for k in moved)


@pytest.mark.parametrize("name", TWO_STAGE)
def test_values_climb_in_it(name: str) -> None:
    settings = {
        "n_updates": 80, "inverse_temperature": 50.0, "actor_learning_rate": 1e-2,
        "slope_limit": 1e3, "frozen_critics": True,
    }  # fmt: skip
    algorithm = trained(name, 41, extraction="anchored", **settings)
    first = algorithm.update(random_batch(2))["extracted_q"]
    for _ in range(30):
        last = algorithm.update(random_batch(2))["extracted_q"]
    assert (last > first).all()


@pytest.mark.parametrize("extraction", SECOND)
def test_it_goes_on_where_it_stopped(extraction: str) -> None:
    whole, broken = (trained("maddpg_bc", n, extraction=extraction) for n in (8, 6))
    again = made(KINDS["maddpg_bc"], 2, n_updates=8, extraction_share=0.5, extraction=extraction)
    again.load_state_dict(broken.state_dict())
    for _ in range(2):
        again.update(random_batch(2))
    for name, value in whole.state_dict().items():
        assert torch.equal(value, again.state_dict()[name]), name


@pytest.mark.parametrize(
    "settings",
    [
        {"inverse_temperature": 0.0},
        {"slope_limit": 0.0},
        {"density_floor": 0.0},
        {"extraction_share": 1.0},
        {"extraction_candidates": 1},
    ],
)
def test_impossible_settings_are_refused(settings: dict[str, Any]) -> None:
    with pytest.raises(SchemaError, match=next(iter(settings))):
        ExtractionConfig(**settings)
