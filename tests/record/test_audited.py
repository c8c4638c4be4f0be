"""What the recorder writes passes the audit, whatever the environment does."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from swarmdata.audit import audit
from tests.record.worlds import Choosing, Counting, record

WORLDS: dict[str, Callable[[], Any]] = {
    "plain": Counting,
    "leaves": lambda: Counting(leaves={"small": 2}),  # whose actions cannot be 0
    "enters": lambda: Counting(enters={"small": 2}),
    "solved when cut": lambda: Counting(success=True),
    "no state": lambda: Counting(has_state=False, terminates=True, success=False),
    "masks": lambda: Choosing("info"),
}


@pytest.mark.parametrize("name", WORLDS)
def test_a_recording_passes_the_audit(name: str, tmp_path: Path) -> None:
    env = WORLDS[name]()
    spaces = {agent: env.action_space(agent) for agent in env.possible_agents}

    def act(agent: str, time: int) -> Any:
        allowed = {"mask": env.mask} if agent == "one" and "mask" in name else {}
        return spaces[agent].sample(**allowed)

    dataset = record(env, tmp_path / "ds", 25, act)
    report = audit(dataset.path, progress=False)
    assert not report.problems, report.problems
    assert np.isfinite(dataset.episodes.team_return).all()
