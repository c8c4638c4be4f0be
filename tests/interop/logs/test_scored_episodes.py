"""Logs are scored by a task as its own world scores them; what cannot be known is refused."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import swarmdata
from swarmdata.audit import audit
from swarmdata.building.edit import filter_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.logs.import_logs import import_logs, remake_logs
from swarmdata.interop.logs.scored_episodes import LoggedMotion, LoggedWorld, layout_of
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import ImportedLogs
from swarmdata.specs.state_layout import TX, X, Y, robots_of
from swarmdata.types import EVENTS, Episode
from tests.interop.logs.logged_team import write_csv
from tests.support.made_episodes import play

ID = "coop_nav-hall-v0"
N = 3
NO_OBSTACLES = dict.fromkeys(("circles", "boxes", "corners", "pockets"), 0)


def task(dynamics: str = "holonomic", **changes: Any) -> swarmdata.TaskSpec:
    content: dict[str, Any] = {
        "rules": {"task": "coop_nav", "arrangement": {"kind": "swap"}},
        "team": [{"count": N, "robot": {"dynamics": dynamics}}],
        "obstacles": NO_OBSTACLES,
        "horizon": 80,
    }
    return swarmdata.TaskSpec.parse({**content, **changes})


def write_logs(folder: Path, spec: swarmdata.TaskSpec, episodes: list[Episode]) -> list[Path]:
    """What each robot would have logged, at the steps of the world, with pauses in between."""
    paths = []
    for k, robot in enumerate(spec.robots):
        names, rows, now = ("t", "x", "y", "yaw", "gx", "gy", "a", "b", "run"), [], 0
        second = robot.max_speed if robot.dynamics == "holonomic" else robot.max_turn_rate
        for run, episode in enumerate(episodes):
            states = robots_of(episode.states, N)[:, k].astype(np.float64)
            actions = np.append(episode.actions[:, k], np.zeros((1, 2), np.float32), axis=0)
            commands = actions.astype(np.float64) * [robot.max_speed, second]
            times, yaw = (
                0.1 * (now + np.arange(len(states))),
                np.arctan2(states[:, 5], states[:, 4]),
            )
            x, y, goals = states[:, X], states[:, Y], states[:, TX : TX + 2]
            runs = np.full(len(states), float(run))
            rows.append(np.column_stack([times, x, y, yaw, goals, commands, runs]))
            now += len(states) + 30
        columns = dict(zip(names, np.concatenate(rows).T, strict=True))
        if k > 0:
            del columns["run"]
        paths.append(write_csv(folder / f"r{k}.csv", columns))
    return paths


def map_of(dynamics: str = "holonomic", **changes: Any) -> dict[str, Any]:
    is_unicycle = dynamics == "unicycle"
    motions = ("v", "omega") if is_unicycle else ("vx", "vy")
    return {
        "dt": 0.1,
        "gaps": "cut",
        "each": {
            "log": "{robot}.csv",
            "time": "t",
            "pose": {"heading": "yaw"},
            "goal": {"x": "gx", "y": "gy"},
            "command": {
                "frame": "body" if is_unicycle else "world",
                "components": [
                    {"column": name, "motion": motion, "low": -4, "high": 4}
                    for name, motion in zip("ab", motions, strict=True)
                ],
            },
        },
        "robots": [f"r{k}" for k in range(N)],
        "episodes": {"marker": {"log": "r0.csv", "time": "t", "column": "run"}},
        **changes,
    }


EACH = map_of()["each"]
WITHOUT_GOALS = {key: value for key, value in EACH.items() if key != "goal"}


def make(folder: Path, logs: list[Path], spec: swarmdata.TaskSpec, **changes: Any) -> Dataset:
    dynamics = spec.robots[0].dynamics
    log_map = LogMap.parse(map_of(dynamics, **changes))
    return import_logs(logs, folder / "dataset", log_map=log_map, id=ID, task=spec)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", ["holonomic", "unicycle"])
def test_the_log_of_a_world_is_scored_as_the_world_scored_it(tmp_path: Path, dynamics: str) -> None:
    spec = task(dynamics)
    played = play(spec, 4)
    dataset = make(tmp_path, write_logs(tmp_path, spec, played), spec)
    assert audit(dataset.path, progress=False).problems == ()
    assert dataset.spec == spec
    assert len(dataset) == len(played)
    same, contacts = [], 0
    for logged, world in zip(dataset, played, strict=True):
        assert len(logged) == len(world) - 1, "the first pose gives the first velocity"
        assert logged.end_reason == world.end_reason
        assert_array_equal(logged.terminations, world.terminations[1:])
        assert_array_equal(logged.truncations, world.truncations[1:])
        ours, theirs = robots_of(logged.states, N), robots_of(world.states[1:], N)
        assert_allclose(ours[..., :2], theirs[..., :2], atol=1e-6)
        assert_allclose(ours[..., 4:], theirs[..., 4:], atol=1e-6)
        bumped = np.asarray(world.events.any(axis=2))
        free = ~bumped[1:] & ~bumped[:-1]
        off = np.abs(ours[1:, :, 2:4] - theirs[1:, :, 2:4])[free]
        assert off.max() < 0.16, "velocities are differences; a step changes them by 0.15 m/s"
        assert_allclose(logged.actions, world.actions[1:], atol=1e-6)
        assert logged.reward_terms is not None
        assert world.reward_terms is not None
        own = [0, 1, 2, -1]  # progress, time, success and proximity need positions alone
        assert_allclose(logged.reward_terms[..., own], world.reward_terms[1:][..., own], atol=1e-5)
        alike = (logged.events == world.events[1:]).all(axis=2)
        assert_allclose(logged.rewards[alike], world.rewards[1:][alike], atol=1e-4)
        same.append(alike.mean())
        contacts += int(world.events[..., EVENTS.index("robot_contact")].sum())
    assert contacts > 10, "robots met"
    assert np.mean(same) > 0.97, "contacts between two steps are interpolated"


def test_the_same_logs_give_it_again_and_it_is_observed_anew(tmp_path: Path) -> None:
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 3))
    dataset = make(tmp_path, logs, spec)
    again = remake_logs(
        logs, tmp_path / "again", ImportedLogs.from_file(dataset.path / "recipe.json")
    )
    assert again.digest == dataset.digest
    view = swarmdata.load(str(dataset.path), observation="lidar", communication="lossy-30")
    assert view[0].observations.shape[0] == len(dataset[0]) + 1
    assert view[0].sent.shape[2] > 0
    assert "computed from the logged poses" in dataset.card
    part = filter_dataset(dataset, tmp_path / "part", id="coop_nav-part-v0", split="train")
    assert audit(part.path, progress=False).problems == ()


def test_an_episode_ends_where_the_task_does(tmp_path: Path) -> None:
    """What robots did after all goals were reached is left out."""
    spec = task()
    played = play(spec, 3)
    late = spec.with_updates(rules={**spec.rules.model_dump(), "goal_radius": 0.6})
    dataset = make(tmp_path, write_logs(tmp_path, spec, played), late)
    assert dataset.episodes.success.any()
    for logged, world in zip(dataset, played, strict=True):
        states = robots_of(world.states[2 : len(logged) + 2], N).astype(np.float64)
        away = np.hypot(*(states[..., TX:] - states[..., :2]).transpose(2, 0, 1))
        reached = (away <= 0.6).all(axis=1)
        assert len(reached) == len(logged)
        assert bool(reached[-1]) == bool(logged.terminations[-1])
        assert not reached[:-1].any()
    assert "steps_after_the_end" in (dataset.recipe.metadata or {})


def test_goals_are_where_robots_went(tmp_path: Path) -> None:
    """Whatever goals they had: hindsight, in episodes of 3 s."""
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 2, "random"))
    dataset = make(
        tmp_path, logs, spec, each=WITHOUT_GOALS, ignore=["gx", "gy"],
        episodes={"length": 3.1, "goals": "reached", "min_steps": 30,
                  "marker": map_of()["episodes"]["marker"]},
    )  # fmt: skip
    assert len(dataset) > 3
    assert dataset.episodes.success.all()
    for episode in dataset:
        states = robots_of(episode.states, N)
        assert (states[:, :, TX:] == states[:1, :, TX:]).all()
        if len(episode) == 30:
            assert_allclose(states[-1, :, :2], states[-1, :, TX:], atol=1e-6)
        away = np.hypot(*(states[-1, :, :2] - states[-1, :, TX:]).T)
        assert (away <= 0.15 + 1e-6).all()
    assert isinstance(dataset.recipe, ImportedLogs)
    again = remake_logs(logs, tmp_path / "again", dataset.recipe)
    assert again.digest == dataset.digest


def test_goals_that_were_reached_need_a_task_and_no_goals(tmp_path: Path) -> None:
    reached = {"goals": "reached"}
    with pytest.raises(SpecError, match="takes the place of `goal`"):
        LogMap.parse(map_of(episodes=reached))
    log_map = LogMap.parse(map_of(each=WITHOUT_GOALS, episodes=reached))
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 1, "idle"))
    with pytest.raises(SpecError, match="a task that scores the logs, --task"):
        import_logs(logs, tmp_path / "dataset", log_map=log_map, id="hall-goals-v0")


def test_commands_have_the_gain_of_their_robots(tmp_path: Path) -> None:
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 1))
    scaled = [{**part, "scale": 0.5} for part in EACH["command"]["components"]]
    plain = make(tmp_path / "plain", logs, spec)
    command = {**EACH["command"], "components": scaled}
    half = make(tmp_path / "half", logs, spec, each={**EACH, "command": command})
    assert_allclose(half[0].actions, 0.5 * plain[0].actions, atol=1e-7)
    assert_array_equal(half[0].states, plain[0].states)


def test_commands_beyond_the_task_are_refused_or_clipped_and_counted(tmp_path: Path) -> None:
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 1))
    slow = task(team=[{"count": N, "robot": {"dynamics": "holonomic", "max_speed": 0.3}}])
    with pytest.raises(ConversionError, match="times the maximum of the task's robot"):
        make(tmp_path, logs, slow)
    clip = {**EACH, "command": {**EACH["command"], "outside": "clip"}}
    notes = make(tmp_path, logs, slow, each=clip).recipe.metadata or {}
    speeds = [np.genfromtxt(log, delimiter=",", names=True)[["a", "b"]] for log in logs]
    n_greater = sum(int((np.maximum(abs(s["a"]), abs(s["b"])) > 0.3001).sum()) for s in speeds)
    assert int(notes["commands_clipped_to_the_task"]) == n_greater


def test_obstacles_of_the_map_are_touched(tmp_path: Path) -> None:
    spec = task(rules={"task": "coop_nav"}, obstacles={**NO_OBSTACLES, "circles": 1, "boxes": 1})
    obstacles = [
        {"shape": "circle", "x": 0.0, "y": 0.0, "half_length": 0.3},
        {"shape": "box", "x": 1.0, "y": 1.0, "heading": 0.3, "half_length": 0.2, "half_width": 0.1},
    ]
    layout = layout_of(spec, LogMap.parse(map_of(obstacles=obstacles)))
    assert layout[:, 0].tolist() == [1, 0], "in the order of the task"
    assert_allclose(layout[0, 1:], [1, 1, np.cos(0.3), np.sin(0.3), 0.2, 0.1, 0], rtol=1e-6)
    with pytest.raises(SpecError, match=r"the task has obstacles: 1 box, 1 circle, and the map 1"):
        layout_of(spec, LogMap.parse(map_of(obstacles=obstacles[:1])))
    with pytest.raises(SpecError, match="has its own obstacles"):
        layout_of(task(), LogMap.parse(map_of(obstacles=obstacles[:1])))
    world = LoggedWorld(swarmdata.make_task(spec))
    robots = np.zeros((2, N, 6))
    robots[..., :2] = [[[1.5, -1.5], [-1.5, -1.5], [x, 0]] for x in (0.5, 0.41)]
    places = np.stack([robots[:1, :, :2], robots[1:, :, :2]], axis=1)
    world.motion = LoggedMotion(places, robots, np.zeros((2, N, 2)), layout)
    world.env.reset(np.zeros(1, np.uint64))
    step = world.env.step(np.zeros((1, N, 2), np.float32))
    touched = step.events[0, :, EVENTS.index("obstacle_contact")]
    assert touched.tolist() == [0, 0, 1], "0.41 m from the middle: radii 0.3 and 0.12"


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gaps": "mask"}, "no robot is ever absent"),
        ({"states": "poses"}, "its states are the task's own"),
        ({"dt": 0.2}, r"dt is 0\.2 s in the map and control_dt 0\.1 s"),
        ({"robots": ["r0"]}, "the map has 1 robots and the task 3"),
        ({"each": {**EACH, "goal": None}}, "the map has no `goal` of r0, r1, r2"),
        ({"each": {**EACH, "reward": {"column": "run"}}}, "reward of r0, which the task computes"),
        ({"each": {**EACH, "command": map_of("unicycle")["each"]["command"]}}, "expected vx, vy "),
    ],
)
def test_what_cannot_be_known_is_refused(
    tmp_path: Path, changes: dict[str, Any], words: str
) -> None:
    path = write_csv(tmp_path / "r0.csv", {"t": [0.0]})
    with pytest.raises(SpecError, match=words):
        make(tmp_path, [path], task(), **changes)


@pytest.mark.parametrize(
    ("task", "id", "words"),
    [
        ("formation", "formation-a-v0", "its states hold more than robots and targets"),
        ("coop_nav", "hall-a-v0", "has to begin with coop_nav-"),
    ],
)
def test_other_tasks_and_ids_are_refused(tmp_path: Path, task: str, id: str, words: str) -> None:
    path = write_csv(tmp_path / "r0.csv", {"t": [0.0]})
    with pytest.raises(SpecError, match=words):
        import_logs(path, tmp_path / "x", log_map=LogMap.parse(map_of()), id=id, task=task)


def test_logs_that_do_not_fit_are_refused(tmp_path: Path) -> None:
    spec = task()
    logs = write_logs(tmp_path, spec, play(spec, 2))
    small = spec.with_updates(arena={"width": 3.4, "height": 2.0}, rules={"task": "coop_nav"})
    with pytest.raises(ConversionError, match="outside the task's arena"):
        make(tmp_path, logs, small)
    slow = task(team=[{"count": N, "robot": {"max_speed": 0.3}}])
    with pytest.raises(ConversionError, match="times the maximum of the task's robot"):
        make(tmp_path, logs, slow)
    with pytest.raises(ConversionError, match="moves within an episode"):
        make(tmp_path, logs, spec, episodes={}, max_gap=60.0, ignore=["run"])
