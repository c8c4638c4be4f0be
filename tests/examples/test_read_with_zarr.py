"""The example computes a dataset's rewards where our package cannot be imported."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr

from swarmdata.envs.coop_nav.navigation_rules import NavigationRewards, NavigationRules
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import open_store
from tests.support.interpreter import python
from tests.support.tiny import TINY, make_tiny

EXAMPLE = Path(__file__).with_name("read_with_zarr.py")

CODE = """
import sys
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("swarmdata", "tests", "envs", "numba", "pymunk", "pydantic"):
            raise ImportError(f"{name} is blocked")
sys.meta_path.insert(0, Blocker())
import runpy
from pathlib import Path
from typing import Any
example = runpy.run_path(sys.argv[1])
print(*(each.max() for each in example["differences"](Path(sys.argv[2]))))
"""

SPEC = TaskSpec(
    horizon=60,
    rules=NavigationRules(rewards=NavigationRewards(team_share=0.25, progress=1.7, time=0.03)),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_tiny(tmp_path_factory.mktemp("outside") / TINY.id, spec=SPEC, n_steps=1500)


def differences(folder: Path, cwd: Path, example: Path = EXAMPLE) -> list[float]:
    """An example's differences by episode, run by an interpreter without our packages."""
    done = python("-I", "-c", CODE, example, folder, cwd=cwd, check=False)
    assert done.returncode == 0, done.stderr
    return [float(word) for word in done.stdout.split()]


def test_rewards_are_computed_again_from_the_folder_alone(folder: Path, tmp_path: Path) -> None:
    """Row 44: the folder alone explains its columns and reward terms."""
    stored = open_store(folder)
    found = differences(folder, tmp_path)
    assert len(found) == len(stored.table)
    assert max(found) < 1e-5
    kinds = stored.table.layouts[..., 0]
    assert set(np.unique(kinds)) == {0, 1, 2, 3}, "the data lack a shape of obstacles"
    assert stored.arrays["events"].any(axis=(0, 1)).all(), "the data lack an event"


def check_notices(folder: Path, cwd: Path, example: Path = EXAMPLE) -> None:
    """An example sees a changed reward."""
    rewards: Any = zarr.open_array(folder / "data.zarr" / "rewards", mode="r+")
    rewards[7, 2] += np.float32(1e-3)
    assert max(differences(folder, cwd, example)) == pytest.approx(1e-3, rel=1e-2)
    rewards[7, 2] -= np.float32(1e-3)


@pytest.mark.slow
def test_the_example_notices_a_changed_reward(folder: Path, tmp_path: Path) -> None:
    check_notices(folder, tmp_path)


def test_it_is_forty_lines() -> None:
    assert len(EXAMPLE.read_text(encoding="utf-8").splitlines()) <= 40
