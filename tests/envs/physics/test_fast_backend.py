"""The fast backend: a used space is as good as a new one, and the public one takes over."""

import pytest

from swarmdata.envs.physics.backend import Plan
from swarmdata.envs.physics.fast_backend import FastBackend
from swarmdata.envs.physics.public_backend import PublicBackend
from swarmdata.envs.world import world
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset


@pytest.mark.parametrize(
    ("missing", "answer"), [("load_addresses", None), ("integrates_exactly", False)]
)
def test_the_public_backend_takes_over(
    monkeypatch: pytest.MonkeyPatch, missing: str, answer: object
) -> None:
    spec = preset("coop_nav")
    plan = Plan(spec, make_task(spec).kinds, ())
    assert isinstance(world.make_backend(plan, 1), FastBackend)
    monkeypatch.setattr(world, missing, lambda: answer)
    assert isinstance(world.make_backend(plan, 1), PublicBackend)
