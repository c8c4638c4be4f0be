"""A small distribution with entry points, really installed: its components take part everywhere."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

pytest.importorskip("torch", reason="algorithms need the torch extra")
pytest.importorskip("matplotlib", reason="studies and sweeps draw figures")

MODULES = {
    "task": """
from typing import Literal

from swarmdata.envs.coop_nav.coop_nav import CoopNav
from swarmdata.envs.coop_nav.navigation_rules import NavigationRules


class MeetingRules(NavigationRules):
    task: Literal["meeting"] = "meeting"
    patience: int = 3


class Meeting(CoopNav):
    Rules = MeetingRules
""",
    "policy": """
import numpy as np

from swarmdata.behavior_policies.simple import Straight


class Slow(Straight):
    def act(self, step):
        return np.float32(0.5) * super().act(step)
""",
    "algorithm": """
from dataclasses import dataclass

from swarmdata.offline_algos.bc import BC, BCConfig


@dataclass(frozen=True)
class MyConfig(BCConfig):
    patience: int = 2


class MyBC(BC):
    Config = MyConfig
""",
    "remote": """
import os
from pathlib import Path

from swarmdata.hub.remotes.hosts.folders import FolderRemote


class Shelf(FolderRemote):
    def __init__(self, address):
        super().__init__(Path(os.environ["MY_SHELF"]).as_uri())
        self.address = address
""",
}

ENTRY_POINTS = """
[swarmdata.tasks]
meeting = my_swarm.task:Meeting

[swarmdata.policies]
slow = my_swarm.policy:Slow

[swarmdata.algorithms]
my_bc = my_swarm.algorithm:MyBC

[swarmdata.remotes]
shelf = my_swarm.remote:Shelf
"""

TASK = """
rules: {task: meeting, patience: 5}
horizon: 40
"""

STUDY = """
name: mine
datasets: [data]
algorithms: [my_bc]
seeds: 1
budget: 0.001
hidden: [8]
settings: {batch_size: 16, patience: 4}
episodes: 4
"""

SCRIPT = """
import sys
sys.path[:] = {path!r}
from swarmdata.cli.main import app
from typer.testing import CliRunner
import swarmdata

def run(command):
    result = CliRunner().invoke(app, command.split())
    assert result.exit_code == 0, (command, result.output, result.exception)
    return result.output

if __name__ == "__main__":
{body}
"""

BODY = """
    import my_swarm.algorithm, my_swarm.policy, my_swarm.task

    spec = swarmdata.TaskSpec.from_file(__import__("pathlib").Path("meeting.yaml"))
    assert spec.rules.patience == 5 and "patience: 5" in run("task show meeting.yaml")
    assert "meeting with 4 robots" in run("task validate meeting.yaml")
    swarmdata.check_task(swarmdata.make_env, spec, n_steps=6)
    slow = swarmdata.make_policy("slow", spec)
    swarmdata.check_policy(slow, spec, swarmdata.make_env, n_episodes=2, n_steps=4)
    swarmdata.check_algorithm(my_swarm.algorithm.MyBC, n_updates=3)
    assert "slow" in run("evaluate slow idle --task meeting.yaml --episodes 4")
    run("generate --task meeting.yaml --policy slow --id meeting-slow-v0 --steps 1200 --workers 1 "
        "--out data")
    assert swarmdata.load("data").task.rules.patience == 5
    run("push data shelf://box")
    assert "meeting-slow-v0" in run("remote list shelf://box")
    run("train my_bc data --updates 3 --seeds 1 --set hidden=8 --set patience=7 --out runs/mine")
    assert "mine" in run("evaluate runs/mine --episodes 4")
    run("render runs/mine --out clip.png")
    run("generate --task meeting.yaml --policy runs/mine --id meeting-mine-v0 --steps 400 "
        "--workers 1 --out mine")
    assert "no problems" in run("audit mine --sample 4")
    run("sweep runs/mine --observation noise=0..0.1 --values 2 --episodes 4 --out sweep")
    run("study study.yaml --out study --work work --workers 1")
    assert "my_bc" in open("study/report.md").read()
"""


def install(site: Path) -> None:
    """Writes a package and the metadata that an installer writes."""
    package, info = site / "my_swarm", site / "my_swarm-1.0.dist-info"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    for name, text in MODULES.items():
        (package / f"{name}.py").write_text(text)
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-swarm\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)


def test_its_components_take_part_everywhere(tmp_path: Path, cache_folder: Path) -> None:
    install(tmp_path / "site")
    (tmp_path / "shelf").mkdir()
    (tmp_path / "meeting.yaml").write_text(TASK)
    (tmp_path / "study.yaml").write_text(STUDY)
    script = tmp_path / "script.py"
    path = [str(tmp_path / "site"), *sys.path]
    script.write_text(SCRIPT.format(path=path, body=BODY))
    environment = {
        **os.environ,
        "PYTHONPATH": os.pathsep.join(path),
        "MY_SHELF": str(tmp_path / "shelf"),
        "SWARMDATA_CACHE": str(cache_folder),
    }
    done = subprocess.run(
        [sys.executable, str(script)], cwd=tmp_path, env=environment, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    recipe = json.loads((tmp_path / "data" / "recipe.json").read_text())
    assert recipe["spec"]["rules"]["patience"] == 5
