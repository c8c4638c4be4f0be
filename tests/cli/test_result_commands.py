"""Options of `evaluate` are read or refused in a sentence."""

import pytest
import typer

from swarmdata.cli.result_commands import parse_budgets
from swarmdata.errors import UnknownNameError


def test_budgets_are_read() -> None:
    texts = ["robot_collisions=0.05", "obstacle_collisions=0"]
    assert parse_budgets(texts) == {"robot_collisions": 0.05, "obstacle_collisions": 0.0}
    with pytest.raises(UnknownNameError, match="Did you mean 'robot_collisions'"):
        parse_budgets(["robots_collisions=1"])


@pytest.mark.parametrize("text", ["-1", "nan", "inf", "few"])
def test_other_budgets_are_refused(text: str) -> None:
    with pytest.raises(typer.BadParameter, match=f"={text}, expected a number of at least 0"):
        parse_budgets([f"robot_collisions={text}"])
