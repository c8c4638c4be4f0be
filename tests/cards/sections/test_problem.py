"""The reward on a card: it says where robots of a team are independent of one another."""

import pytest

from swarmdata.cards.sections.problem import (
    SINGLE_ROBOT_NOTE,
    definitions_section,
    reward_section,
    task_section,
)
from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.envs.formation.formation_rules import FormationRules
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.task_spec import TaskSpec


def says_so(spec: TaskSpec) -> bool:
    return SINGLE_ROBOT_NOTE in reward_section(make_task(spec))


@pytest.mark.parametrize("name", preset_names())
def test_independent_rewards_are_named_on_the_card(name: str) -> None:
    spec = preset(name)
    rules = spec.rules.model_dump()
    is_shared = rules.get("goals") == "unassigned" or rules.get("slots") == "assigned"
    assert says_so(spec) == (
        spec.task not in ("transport", "search", "pursuit", "tag") and not is_shared
    )


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_a_share_of_the_teams_reward_makes_robots_depend_on_one_another(share: float) -> None:
    rewards = {"team_share": share}
    assert says_so(TaskSpec(rules=NavigationRules.parse({"rewards": rewards}))) == (share == 0)
    fixed = FormationRules.parse({"slots": "fixed", "rewards": rewards})
    assert says_so(preset("formation").with_updates(rules=fixed.model_dump())) == (share == 0)


def test_ranges_that_episodes_draw_from_are_on_the_card() -> None:
    spec = preset("coop_nav").with_updates(randomization={"mass": (1.0, 2.0)})
    assert "| drawn in each episode: mass | 1, 2 |" in task_section(make_task(spec))
    assert "drawn in each episode" not in task_section(make_task(preset("coop_nav")))


def test_definitions_have_the_numbers_of_the_spec() -> None:
    spec = preset("search")
    rules = spec.rules.model_dump()
    near = spec.with_updates(
        rules={**rules, "sight_range": 0.987, "cell_size": 1.25},
        arena={"width": 5.0, "height": 6.0},
    )
    text = definitions_section(make_task(near))
    for name in ("searched_c", "known_k", "rescued", "_way"):
        assert f"`{name}`" in text
    assert "at most 0.987 m" in text
    assert "number c mod 4 along x" in text
    without = near.with_updates(observation={**near.observation.model_dump(), "ways": False})
    assert "`_way`" not in definitions_section(make_task(without))
    assert not definitions_section(make_task(preset("coop_nav")))
