"""A task of a user, as another package would define it, and datasets of it."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import pytest

import swarmdata
from swarmdata.envs.coop_nav.coop_nav import CoopNav
from swarmdata.envs.coop_nav.navigation_rules import NavigationRules
from swarmdata.runtime import own_components
from swarmdata.runtime.own_components import GROUPS, REGISTERED_VARIABLE
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from tests.support.tiny import make_tiny


class ThriftyRules(NavigationRules):
    """Rules of `thrifty`."""

    task: Literal["thrifty"] = "thrifty"  # type: ignore[assignment]


class Thrifty(CoopNav):
    """`coop_nav` under another name."""

    Rules = ThriftyRules


@contextmanager
def nothing_registered() -> Iterator[None]:
    """Undoes, at its end, what is registered in it; at its beginning nothing is."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(own_components, "_here", {group: {} for group in GROUPS})
        patch.setenv(REGISTERED_VARIABLE, "{}")
        yield


@contextmanager
def thrifty_installed() -> Iterator[TaskSpec]:
    """Has the task `thrifty`; gives a spec of it."""
    with nothing_registered():
        swarmdata.register_task("thrifty", Thrifty)
        yield TaskSpec.parse({"rules": {"task": "thrifty"}, "horizon": 40})


def make_thrifty(out: Path) -> Path:
    """Builds a small dataset of the task in this process; afterwards the task is not known."""
    with thrifty_installed() as spec:
        policies = (PolicySource(label="a", name="random"),)
        return make_tiny(out, id="thrifty-tiny-v0", spec=spec, policies=policies)
