"""A shipped dataset is rebuilt from its recipe with the published digest."""

import pytest

import swarmdata
from swarmdata.registry.published import published
from tests.benchmarks.bench_digests import Built, build
from tests.benchmarks.variants import Variant, variants

LEARNED, FEW = "coop_nav-medium-mini", 4000
"""A dataset whose policies are networks, and so few joint steps that a build takes seconds."""


def test_a_mini_dataset_rebuilds_to_its_published_digest() -> None:
    """With workers, as for users: the one default test in which a build ends in processes."""
    dataset = swarmdata.load("coop_nav-medium-mini", progress=False)
    assert dataset.source == "rebuilt"
    assert dataset.digest == published()[dataset.id].digest
    again = swarmdata.load("coop_nav-medium-mini")
    assert again.source == "cache"
    assert again.digest == dataset.digest


@pytest.mark.slow
@pytest.mark.parametrize("tier", ["random", "scripted", "expert", "medium-expert"])
def test_the_other_minis_rebuild_to_their_published_digests(tier: str) -> None:
    dataset = swarmdata.load(f"coop_nav-{tier}-mini", progress=False)
    assert dataset.digest == published()[dataset.id].digest


@pytest.fixture(scope="module")
def default() -> Built:
    found = build(LEARNED, variants()[0], n_steps=FEW)
    assert found.message == ""
    return found


@pytest.mark.slow
@pytest.mark.parametrize("variant", variants()[1:], ids=lambda variant: str(variant.name))
def test_a_learned_mini_has_one_digest_under_every_variant(
    variant: Variant, default: Built
) -> None:
    if reason := variant.unavailable():
        pytest.skip(reason)
    found = build(LEARNED, variant, n_steps=FEW, typical=default.seconds)
    assert found.message == ""
    assert found.digest == default.digest
