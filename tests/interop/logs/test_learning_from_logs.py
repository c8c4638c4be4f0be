"""From bags of four robots to a policy that drives in a world of the same spaces."""

from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from pettingzoo import ParallelEnv

import swarmdata
from swarmdata.audit import audit
from swarmdata.specs.origins.log_map import LogMap
from tests.interop.logs import bags

torch = pytest.importorskip("torch", reason="algorithms need torch")
pytest.importorskip("rosbags", reason="the extra 'logs'")
pytest.importorskip("mcap", reason="the extra 'logs'")


class Floor(ParallelEnv[str, Any, Any]):  # type: ignore[misc]
    """Unicycles that observe what the logged robots did; rewards for driving as they did."""

    metadata: ClassVar = {"name": "floor"}

    def __init__(self, *, sees_pose: bool = True) -> None:
        self.hidden = () if sees_pose else ("pose",)
        self.possible_agents = list(bags.ROBOTS)
        self.agents: list[str] = []

    def observation_space(self, agent: str) -> gymnasium.spaces.Dict:
        box = gymnasium.spaces.Box
        spaces = {
            "pose": box(-np.inf, np.inf, (4,), np.float32),
            "scan": box(0.0, 3.5, (4,), np.float32),
            "scan_known": box(0.0, 1.0, (1,), np.float32),
        }
        return gymnasium.spaces.Dict({k: v for k, v in spaces.items() if k not in self.hidden})

    def action_space(self, agent: str) -> gymnasium.spaces.Box:
        bounds = np.array([0.5, 1.0], np.float32)
        return gymnasium.spaces.Box(-bounds, bounds)

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.agents, self.time = list(self.possible_agents), 0
        start = np.random.default_rng(seed).normal(size=(4, 3))
        self.poses = dict(zip(self.agents, start, strict=True))
        return self._observations(), {name: {} for name in self.agents}

    def step(self, actions: Any) -> tuple[Any, ...]:
        for name, (speed, turn) in actions.items():
            x, y, yaw = self.poses[name]
            step = 0.1 * speed
            self.poses[name] = np.array(
                [x + step * np.cos(yaw), y + step * np.sin(yaw), yaw + 0.1 * turn]
            )
        self.time += 1
        names, over = self.agents, self.time == 20
        observations = self._observations()
        self.agents = [] if over else names
        flags = dict.fromkeys(names, over)
        rewards = {
            name: -abs(float(speed) - bags.SPEED) - abs(float(turn) - bags.TURN)
            for name, (speed, turn) in actions.items()
        }
        return observations, rewards, dict.fromkeys(names, False), flags, {}

    def _observations(self) -> dict[str, Any]:
        found = {}
        for name in self.agents:
            x, y, yaw = self.poses[name]
            pose = np.array([x, y, np.cos(yaw), np.sin(yaw)], np.float32)
            ones = np.ones(1, np.float32)
            seen = {"pose": pose, "scan": np.tile([1.0, 3.5], 2).astype(np.float32),
                    "scan_known": ones}  # fmt: skip
            found[name] = {key: value for key, value in seen.items() if key not in self.hidden}
        return found


@pytest.mark.slow
@pytest.mark.parametrize("states", ["observations", "poses"])
def test_bags_are_imported_learned_from_and_played(tmp_path: Path, states: str) -> None:
    log = bags.write_ros2(tmp_path / "monday", storage="mcap", seconds=30.0)
    dataset = swarmdata.import_logs(
        log,
        tmp_path / "dataset",
        log_map=LogMap.parse({**bags.MAP, "states": states}),
        id="hall-bags-v0",
    )
    if states == "observations":  # scans alone never change
        assert audit(dataset.path, progress=False).problems == ()
    (policy,) = swarmdata.train(
        "bc", str(dataset.path), tmp_path / "run", n_seeds=1, progress=False,
        changes={"n_updates": "400", "batch_size": "64", "hidden": "32"},
    )  # fmt: skip
    assert isinstance(dataset.spec, swarmdata.RecordedSpec)
    seeds = swarmdata.foreign_evaluation_seeds(3)
    floor = partial(Floor, sees_pose=states == "observations")
    played = swarmdata.evaluate_parallel(policy, floor, dataset.spec, seeds)
    assert played.metrics["length"].tolist() == [20.0] * 3
    assert played.metrics["return"].min() > -0.15 * 20  # standing still has -0.7 in a step
