"""A shipped dataset is rebuilt from its recipe with the published digest."""

import pytest

import swarmdata
from swarmdata.cards.schema import published


@pytest.mark.parametrize("tier", ["medium", "scripted", "random"])
def test_a_mini_dataset_rebuilds_to_its_published_digest(tier: str) -> None:
    dataset = swarmdata.load(f"coop_nav-{tier}-mini", progress=False)
    assert dataset.source == "rebuilt"
    assert dataset.digest == published()[dataset.id].digest
    again = swarmdata.load(f"coop_nav-{tier}-mini")
    assert again.source == "cache"
    assert again.digest == dataset.digest


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["expert", "medium-expert"])
def test_the_other_minis_rebuild_to_their_published_digests(tier: str) -> None:
    dataset = swarmdata.load(f"coop_nav-{tier}-mini", progress=False)
    assert dataset.digest == published()[dataset.id].digest
