"""The example computes own terms of two tasks where our package cannot be imported."""

from pathlib import Path

import pytest

from swarmdata.registry.presets import preset
from swarmdata.specs.recipe import PolicySource
from swarmdata.store import open_store
from tests.examples.test_read_with_zarr import check_notices, differences
from tests.support.pairs import slow
from tests.support.tiny import make_tiny

EXAMPLE = Path(__file__).with_name("own_terms.py")
POLICIES = (PolicySource(label="a", name="scripted"), PolicySource(label="b", name="random"))


@pytest.fixture(scope="module", params=slow("search", "intersection"))
def folder(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "coop_nav-tiny-v0"
    return make_tiny(path, spec=preset(request.param), policies=POLICIES, n_steps=600)


def test_own_terms_are_computed_again_from_states_and_attributes(
    folder: Path, tmp_path: Path
) -> None:
    stored = open_store(folder)
    found = differences(folder, tmp_path, EXAMPLE)
    assert len(found) == len(stored.table)
    assert max(found) < 1e-5
    n_own = len(stored.arrays["reward_terms"][0, 0]) - 6
    assert stored.arrays["reward_terms"][..., :n_own].any(axis=(0, 1)).all(), "a term is always 0"


@pytest.mark.slow
def test_the_example_notices_a_changed_reward(folder: Path, tmp_path: Path) -> None:
    check_notices(folder, tmp_path, EXAMPLE)
