"""The pages of worlds show the measured references; tasks are neither trivial nor hopeless."""

import pytest

from swarmdata.cards.worlds_page import worlds_pages
from swarmdata.registry.presets import preset
from swarmdata.registry.published import TaskReferences, references


def value(entry: TaskReferences, policy: str, metric: str) -> float:
    interval = entry.policies[policy][metric]
    assert interval is not None
    return interval.value


def test_a_preset_that_was_not_measured_is_named() -> None:
    known = dict(references())
    del known["formation"]
    pages = worlds_pages(known)
    assert pages["formation.md"].count("This version of the preset was not measured.") == 1
    assert "[`formation`](formation.md#formation) |  |  |  |  |" in pages["README.md"]


@pytest.mark.parametrize("name", sorted(set(references()) - {"tag-evader"}))  # who wins seldom
def test_the_scripted_team_solves_what_others_do_not(name: str) -> None:
    entry = references()[name]
    assert value(entry, "scripted", "success") >= 0.8
    assert max(value(entry, policy, "success") for policy in ("idle", "random")) <= 0.01
    random, idle, scripted = (
        value(entry, policy, "return") for policy in ("random", "idle", "scripted")
    )
    assert max(random, idle) < scripted
    spec = preset(name.removesuffix("-pursuers"))
    ends_at_contact = spec.on_collision == "fail"  # then moving at random is over soon
    assert ends_at_contact or random < idle
