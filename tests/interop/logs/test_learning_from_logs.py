"""From bags of four robots to a policy that drives in a world of the same spaces."""

from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from gymnasium.spaces import Box, Dict

import swarmdata
from swarmdata.audit import audit
from swarmdata.specs.origins.log_map import LogMap
from tests.interop.logs import bags
from tests.record.worlds import Together

torch = pytest.importorskip("torch", reason="algorithms need torch")
pytest.importorskip("rosbags", reason="the extra 'logs'")
pytest.importorskip("mcap", reason="the extra 'logs'")


class Floor(Together):
    """Unicycles that observe what the logged robots did; rewards for driving as they did."""

    NAME, length = "floor", 20
    LARGEST = np.array([0.5, 1.0], np.float32)
    ACTIONS: ClassVar[Any] = dict.fromkeys(bags.ROBOTS, Box(-LARGEST, LARGEST))

    def __init__(self, *, sees_pose: bool = True) -> None:
        super().__init__()
        spaces = {"scan": Box(0.0, 3.5, (4,)), "scan_known": Box(0.0, 1.0, (1,))}
        self.seen = Dict(spaces | ({"pose": Box(-np.inf, np.inf, (4,))} if sees_pose else {}))

    def observation_space(self, agent: str) -> Dict:
        return self.seen

    def reset(self, seed: int | None = None, options: Any = None) -> tuple[Any, Any]:
        self.poses = np.random.default_rng(seed).normal(size=(4, 3))
        return super().reset(seed)

    def rewards(self, actions: dict[str, Any]) -> dict[str, float]:
        x, y, yaw = self.poses.T
        speed, turn = np.array(list(actions.values()), np.float64).T
        moved = [x + 0.1 * speed * np.cos(yaw), y + 0.1 * speed * np.sin(yaw), yaw + 0.1 * turn]
        self.poses = np.stack(moved, axis=1)
        found = -abs(speed - bags.SPEED) - abs(turn - bags.TURN)
        return dict(zip(actions, found.tolist(), strict=True))

    def observe(self) -> dict[str, Any]:
        x, y, yaw = self.poses.T
        poses = np.stack([x, y, np.cos(yaw), np.sin(yaw)], axis=1).astype(np.float32)
        seen = {"scan": np.tile([1.0, 3.5], 2).astype(np.float32), "scan_known": np.ones(1)}
        return {
            name: {key: {**seen, "pose": pose}[key] for key in self.seen}
            for name, pose in zip(self.possible_agents, poses, strict=True)
        }


@pytest.mark.slow
@pytest.mark.parametrize("states", ["observations", "poses"])
def test_bags_are_imported_learned_from_and_played(tmp_path: Path, states: str) -> None:
    log = bags.write_ros2(tmp_path / "monday", storage="mcap", seconds=30.0)
    log_map = LogMap.parse({**bags.MAP, "states": states})
    dataset = swarmdata.import_logs(log, tmp_path / "dataset", log_map=log_map, id="hall-bags-v0")
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
