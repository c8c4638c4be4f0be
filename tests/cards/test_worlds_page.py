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


def test_a_table_has_a_row_for_a_tier_and_a_score_where_there_is_an_expert() -> None:
    page = worlds_pages(references())["formation.md"]
    headline, easy = (page.partition(f"## `{name}`")[2] for name in ("formation", "formation-easy"))
    policies = ("idle", "random", "straight", "scripted", "medium", "expert")
    shown = headline.partition("\n## ")[0].partition("\n| gap to")[0]
    assert [row.split(" | ")[0][2:] for row in shown.splitlines()[-6:]] == list(policies)
    assert "| policy | score | return | success (%) |" in headline
    assert "| policy | return | success (%) |" in easy.partition("\n## ")[0]


@pytest.mark.parametrize("name", references())
def test_the_scripted_team_solves_what_others_do_not(name: str) -> None:
    entry = references()[name]
    assert value(entry, "scripted", "success") >= 0.8
    assert max(value(entry, policy, "success") for policy in ("idle", "random")) <= 0.01
    random, idle, scripted = (
        value(entry, policy, "return") for policy in ("random", "idle", "scripted")
    )
    assert max(random, idle) < scripted
    ends_at_contact = preset(name).on_collision == "fail"  # then moving at random is over soon
    assert ends_at_contact or random < idle
