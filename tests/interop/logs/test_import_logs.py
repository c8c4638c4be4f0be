"""Tables of robots become datasets: what is in them, what is refused, that they can be remade."""

import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from typer.testing import CliRunner

from swarmdata.audit import audit
from swarmdata.cli.main import app
from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import ConversionError, MissingExtraError, SpecError
from swarmdata.interop.logs.import_logs import import_logs, remake_logs
from swarmdata.specs.origins.log_origin import ImportedLogs
from swarmdata.specs.spaces import bounds
from tests.interop.logs.logged_team import (
    MAP,
    SPEED,
    TURN,
    bounded,
    drive,
    each,
    log_map,
    write_csv,
    write_team,
)
from tests.support.command_line import run

ID = "hall-monday-v0"
ANGLE = {"name": "bearing", "column": {"column": "b", "unit": "deg"}, "between": "angle"}


def make(folder: Path, logs: Any, **changes: Any) -> Dataset:
    changes.setdefault("episodes", {"length": 2.0})
    out = folder / "dataset"
    shutil.rmtree(out, ignore_errors=True)
    return import_logs(logs, out, log_map=log_map(**changes), id=ID)


def assert_audited(dataset: Dataset) -> None:
    assert audit(dataset.path, progress=False).problems == ()


def notes(dataset: Dataset) -> Mapping[str, str]:
    return dataset.recipe.metadata or {}


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    """A minute of both robots, in a file each."""
    return write_team(tmp_path)


def without(columns: dict[str, np.ndarray], start: float, stop: float) -> dict[str, np.ndarray]:
    """The rows outside some seconds of a log."""
    seconds = columns["t"] - columns["t"][0]
    kept = (seconds < start) | (seconds > stop)
    return {name: values[kept] for name, values in columns.items()}


def test_a_team_becomes_a_dataset(tmp_path: Path) -> None:
    dataset = make(tmp_path, write_team(tmp_path))
    assert_audited(dataset)
    assert dataset.spec.time_step == 0.1
    assert dataset.spec.agent_names == ("anna", "bert")
    assert dataset.spec.horizon == 20
    assert len(dataset) == 29
    episode = dataset[3]
    assert episode.alive is None
    t = 3 * 21 * 0.1 + 0.1 * np.arange(21)
    expected = np.stack([SPEED / TURN * np.sin(TURN * t), -SPEED / TURN * np.cos(TURN * t),
                         np.cos(TURN * t), np.sin(TURN * t)], axis=1)  # fmt: skip
    assert_allclose(episode.observations[:, 0], expected, atol=1e-4)
    assert_allclose(episode.actions[:, 0, 0], SPEED * (1 + 0.1 * np.sin(3 * t[:-1])), atol=1e-6)
    assert_array_equal(episode.states, episode.observations.reshape(21, 8))
    assert "The same logs give this dataset again" in dataset.card
    assert "A step takes 0.1 s." in dataset.card


def test_the_same_logs_give_it_again(tmp_path: Path, logs: list[Path]) -> None:
    dataset = make(tmp_path, logs)
    origin = ImportedLogs.from_file(dataset.path / "recipe.json")
    again = remake_logs(logs, tmp_path / "again", origin)
    files = [path.relative_to(dataset.path) for path in dataset.path.rglob("*") if path.is_file()]
    assert len(files) > 10
    for file in files:
        assert (again.path / file).read_bytes() == (dataset.path / file).read_bytes(), file
    logs[0].write_text(logs[0].read_text().replace("0.4", "0.3", 1))
    with pytest.raises(ConversionError, match=r"was made of other logs: anna\.csv differ"):
        remake_logs(logs, tmp_path / "other", origin)


def test_one_file_for_all(tmp_path: Path) -> None:
    columns = [{**drive(60.0, float(k)), "id": np.full(1200, k)} for k in (0, 1)]
    joined = {name: np.concatenate([c[name] for c in columns]) for name in columns[0]}
    separate = make(tmp_path, write_team(tmp_path))
    log = write_csv(tmp_path / "all.csv", joined)
    shared = {key: value for key, value in MAP["each"].items() if key != "log"}
    robots = [{"name": "anna", "rows": {"id": 0}}, {"name": "bert", "rows": {"id": 1}}]
    assert make(tmp_path, log, each=shared, robots=robots).digest == separate.digest
    named = make(tmp_path, log, each={**shared, "rows": {"id": "{robot}"}}, robots=["0", "1"])
    assert named.spec.agent_names == ("0", "1")


def test_parquet_is_read_like_text(tmp_path: Path) -> None:
    arrow = pytest.importorskip("pyarrow", reason="the extra 'parquet'")
    parquet = pytest.importorskip("pyarrow.parquet", reason="the extra 'parquet'")
    text = make(tmp_path, write_team(tmp_path))
    for name, phase in (("anna", 0.0), ("bert", 1.0)):
        columns: dict[str, Any] = drive(60.0, phase)
        nanoseconds = np.round(columns["t"] * 1e9).astype(np.int64)
        columns["t"] = arrow.array(nanoseconds).cast(arrow.timestamp("ns"))
        parquet.write_table(arrow.table(columns), tmp_path / f"{name}.parquet")
    logs = [tmp_path / "anna.parquet", tmp_path / "bert.parquet"]
    assert make(tmp_path, logs, each=each(log="{robot}.parquet")).digest == text.digest


def test_a_gap_makes_a_robot_absent_or_cuts(tmp_path: Path, logs: list[Path]) -> None:
    write_csv(logs[1], without(drive(60.0, 1.0), 10.0, 11.0))
    dataset = make(tmp_path, logs, episodes={})
    assert_audited(dataset)
    assert "absent_robot_steps" in notes(dataset)
    (episode,) = list(dataset)
    assert episode.alive is not None
    gone = np.flatnonzero(~episode.alive[:-1, 1])
    assert 0.1 * gone[0] == pytest.approx(9.9)  # its next pose is not known
    assert 0.1 * gone[-1] == pytest.approx(11.0)
    assert episode.alive[:-1, 0].all()
    assert not episode.alive[-1].any()
    assert not episode.observations[gone[1:], 1].any()
    assert episode.observations[gone[0], 1].any()  # the state in which it stopped acting
    assert not episode.actions[gone, 1].any()
    assert episode.agent_truncations is not None
    ends = np.flatnonzero(episode.agent_truncations[:, 1])
    assert ends.tolist() == [gone[0] - 1, len(episode) - 1]
    cut = make(tmp_path, logs, gaps="cut", episodes={})
    assert_audited(cut)
    assert cut[0].alive is None
    assert [len(episode) for episode in cut] == [99, 488]


def test_steps_in_no_episode_are_counted_and_printed(tmp_path: Path, logs: list[Path]) -> None:
    write_csv(logs[1], without(drive(60.0, 1.0), 10.0, 11.0))
    whole = make(tmp_path, logs, episodes={})
    lengths = {"length": 2.0, "min_steps": 12}
    cut = make(tmp_path, logs, gaps="cut", episodes=lengths)
    counts = [int(notes(cut)[f"steps_{which}_episodes"]) for which in ("of_short", "between")]
    assert min(counts) > 0
    assert cut.n_steps + sum(counts) == whole.n_steps
    (tmp_path / "map.yaml").write_text(log_map(gaps="cut", episodes=lengths).to_yaml())
    printed = run("import", *logs, "--map", tmp_path / "map.yaml", "--id", ID)
    assert f"{counts[1]} steps are left out: they are between episodes" in printed


def test_an_import_into_the_cache_has_no_published_id(tmp_path: Path, logs: list[Path]) -> None:
    (tmp_path / "map.yaml").write_text(log_map().to_yaml())
    options = ("--map", tmp_path / "map.yaml", "--id", "coop_nav-medium-v1")
    assert "is the id of a dataset of the package" in run("import", *logs, *options, code=1)


def test_clock_offsets_shift_a_robot(tmp_path: Path) -> None:
    anna, bert = write_team(tmp_path)
    late = drive(60.0, 1.0)
    late["t"] = late["t"] - 5.25
    straight = make(tmp_path, [anna, bert])
    write_csv(bert, late)
    offset = [{"name": "anna"}, {"name": "bert", "clock_offset": 5.25}]
    assert make(tmp_path, [anna, bert], robots=offset).digest == straight.digest


def test_units_and_frames(tmp_path: Path, logs: list[Path]) -> None:
    straight = make(tmp_path, logs)
    for path, phase in zip(logs, (0.0, 1.0), strict=True):
        columns = drive(60.0, phase)
        x, y = columns["x"], columns["y"]
        # the frame `hall` stands at (2, 1) and is turned by a quarter
        columns |= {"x": 1000 * (y - 1), "y": -1000 * (x - 2), "yaw": columns["yaw"] - 90}
        columns["t"] = np.round(1000 * columns["t"])
        write_csv(path, columns)
    place = {axis: {"column": axis, "unit": "mm"} for axis in "xy"}
    pose = {**place, "heading": {"column": "yaw", "unit": "deg"}, "frame": "hall"}
    signals = each(time={"column": "t", "unit": "ms"}, pose=pose)
    hall = {"frame": "hall", "parent": "world", "x": 2, "y": 1, "heading": np.pi / 2}
    turned = make(tmp_path, logs, transforms=[hall], each=signals)
    assert_allclose(turned[4].observations, straight[4].observations, atol=1e-5)


def test_scans_features_goals_and_rewards(tmp_path: Path, logs: list[Path]) -> None:
    for path in logs:
        columns: dict[str, Any] = drive(60.0, float(path.stem == "bert"))
        n = len(columns["t"])
        columns["b"] = np.full(n, 90.0)
        columns["gx"] = np.where(columns["t"] < 1030, 1.0, 2.0)
        columns["gy"] = np.zeros(n)
        columns["r"] = np.full(n, 0.5)
        ranges = np.tile([0.5, 9.0, np.inf, 1.0], (n, 1)).astype(object)
        ranges[n // 2 :, 3] = "nan"
        columns |= {f"scan_{k}": ranges[:, k] for k in range(4)}
        write_csv(path, columns)
    dataset = make(
        tmp_path, logs, episodes={"goal_change": 0.5, "ends": "termination"},
        each=each(features=[ANGLE], goal={"x": "gx", "y": "gy"}, reward={"column": "r"},
                  scan={"columns": ["scan_*"], "range_max": 5.0, "beams": 2}),
    )  # fmt: skip
    assert_audited(dataset)
    first, second = dataset
    assert first.terminations[-1]
    assert second.truncations[-1]
    assert (first.rewards == 1.0).all()
    names = ["bearing", "bearing_known", "goal", "goal_known", "pose", "scan", "scan_known"]
    space = dataset.spec.observation_spaces(0)[0]
    assert sorted(space.model_dump()["spaces"]) == names
    row, later = first.observations[0, 0], second.observations[5, 0]
    assert_allclose(row[:6], [0, 1, 1, 1, 0, 1], atol=1e-6)  # bearing, known, goal, known
    assert_allclose(row[-3:], [0.5, 1.0, 1.0])
    assert_array_equal(later[-3:], 0)  # NaN beams: nothing is known of the scan
    assert_array_equal(later[3:5], [2, 0])
    assert_array_equal(first.observations[..., 3], 1)  # no state of the next goal


def test_commands_from_poses_are_flagged(tmp_path: Path, logs: list[Path]) -> None:
    command = {"components": bounded(v=1, omega=1), "differences": True}
    dataset = make(tmp_path, logs, each=each(command=command), ignore=["v", "omega"])
    assert_audited(dataset)
    assert_allclose(dataset[0].actions[..., 0], SPEED, rtol=2e-3)
    assert_allclose(dataset[0].actions[..., 1], TURN, rtol=1e-3)
    assert notes(dataset)["actions_from_poses"] == "anna, bert"
    assert notes(dataset)["ignored"] == "v, omega"
    assert "**The actions of anna, bert are no commands**" in dataset.card


def test_markers_cut(tmp_path: Path, logs: list[Path]) -> None:
    columns: dict[str, Any] = drive(60.0)
    columns["trial"] = np.where(columns["t"] < 1020, "first", "second")
    write_csv(logs[0], columns)
    marker = {"log": "anna.csv", "time": "t", "column": "trial"}
    dataset = make(tmp_path, logs, episodes={"marker": marker})
    assert [len(episode) for episode in dataset] == [199, 399]
    assert_audited(dataset)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"ignore": []}, r"bert\.csv has columns that the map does not use: note"),
        ({"robots": ["anna"]}, r"uses nothing of bert\.csv"),
        ({"each": each(log="carl.csv")}, r"pose of anna is in carl\.csv, expected one of anna"),
        ({"each": each(time="stamp")}, r"anna\.csv has no column 'stamp'"),
        ({"each": each(rows={"x": 77})}, "no row has 77 in column 'x'"),
        ({"each": each(pose={"heading": {"column": "yaw", "unit": "m"}})}, "a unit of angle"),
        (
            {"each": each(pose={**MAP["each"]["pose"], "frame": "odom"})},
            "in the frame 'odom', and no",
        ),
        ({"max_gap": 0.01, "dt": 0.03}, "pose known at"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(
    tmp_path: Path, logs: list[Path], changes: dict[str, Any], message: str
) -> None:
    columns: dict[str, Any] = drive(60.0, 1.0)
    write_csv(logs[1], {**columns, "note": columns["x"]})
    with pytest.raises(ConversionError, match=message):
        make(tmp_path, logs, **{"ignore": ["note"], **changes})
    assert not (tmp_path / "dataset").exists()


def test_commands_outside_their_bounds(tmp_path: Path, logs: list[Path]) -> None:
    narrow = [{"column": "v", "low": 0, "high": 0.4}, *bounded(omega=1)]
    with pytest.raises(ConversionError, match=r"command v of anna is 0\.4.*expected 0 to 0\.4"):
        make(tmp_path, logs, each=each(command={"components": narrow}))
    command = {"components": narrow, "outside": "clip"}
    dataset = make(tmp_path, logs, each=each(command=command))
    assert_audited(dataset)
    assert dataset[0].actions.max() == np.float32(0.5)
    assert dataset[0].actions[..., 0].max() == np.float32(0.4)
    assert "clipped_commands" in notes(dataset)


def test_bounds_that_are_left_out_are_those_of_the_team(tmp_path: Path, logs: list[Path]) -> None:
    components = [{"column": "v"}, *bounded(omega=1)]
    dataset = make(tmp_path, logs, each=each(command={"components": components}))
    logged = np.concatenate([drive(60.0, phase)["v"] for phase in (0.0, 1.0)])
    for space in dataset.spec.action_spaces:
        lows, highs = bounds(space)
        assert_allclose(lows, [logged.min(), -1], rtol=1e-6)
        assert_allclose(highs, [logged.max(), 1], rtol=1e-6)
    components = [{"column": "v"}, {"column": "omega"}]  # omega is constant
    with pytest.raises(ConversionError, match="omega never changes in the logs"):
        make(tmp_path, logs, each=each(command={"components": components}))


def test_cells_that_are_empty_are_gaps_and_words_are_refused(
    tmp_path: Path, logs: list[Path]
) -> None:
    columns: dict[str, Any] = {key: v.astype(object) for key, v in drive(60.0, 1.0).items()}
    columns["x"][300:340] = ""
    write_csv(logs[1], columns)
    assert make(tmp_path, logs)[7].alive is not None
    columns["x"][5] = "lost"
    write_csv(logs[1], columns)
    with pytest.raises(ConversionError, match=r"bert\.csv, row 6, x is 'lost', expected a number"):
        make(tmp_path, logs)


@pytest.mark.slow
def test_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "cache"))
    logs = [str(path) for path in write_team(tmp_path)]
    note = tmp_path / "robots.yaml"
    note.write_text(log_map(episodes={"length": 2.0}).to_yaml())
    run = CliRunner().invoke
    result = run(app, ["import", *logs, "--map", str(note), "--id", ID, "--note", "license=mit"])
    assert result.exit_code == 0, result.output
    made = tmp_path / "cache" / "datasets" / ID
    assert "29 episodes, 571 joint steps" in result.output
    assert "validation" not in result.output
    assert Dataset.open(made).recipe.license == "mit"
    recipe, again = made / "recipe.json", tmp_path / "again"
    result = run(app, ["import", *logs, "--map", str(recipe), "--out", str(again)])
    assert result.exit_code == 0, result.output
    assert Dataset.open(again).digest == Dataset.open(made).digest
    result = run(app, ["import", *logs, "--map", str(recipe), "--seed", "3"])
    assert "--seed" in result.output
    result = run(app, ["import", *logs, "--map", str(note)])
    assert "--id" in result.output


def test_the_command_line_names_gaps_and_an_empty_split(tmp_path: Path) -> None:
    logs = write_team(tmp_path, 9.0)
    write_csv(logs[1], without(drive(9.0, 1.0), 3.0, 4.0))
    note = tmp_path / "robots.yaml"
    note.write_text(log_map(episodes={"length": 2.0}).to_yaml())
    line = ["import", *map(str, logs), "--map", str(note), "--id", ID, "--out", str(tmp_path / ID)]
    output = CliRunner().invoke(app, line).output
    assert "Robots are absent in 12 steps: their pose or command is unknown" in output
    assert "the validation split is empty: none of 5 episodes fell into it" in output


def test_bags_need_their_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "monday.bag").write_bytes(b"")
    monkeypatch.setattr("swarmdata.runtime.extras.find_spec", lambda package: None)
    with pytest.raises(MissingExtraError, match=r"swarmdata\[logs\]"):
        make(tmp_path, tmp_path / "monday.bag", each=each(log="monday.bag", topic="/pose"))


@pytest.mark.parametrize(("over", "expected"), [("sum", 1.0), ("held", 0.25)])
def test_rewards_of_one_time_are_added_up_unless_held(
    tmp_path: Path, logs: list[Path], over: str, expected: float
) -> None:
    columns = {**drive(60.0), "r": np.full(1200, 0.25)}
    twice = {name: np.repeat(values, 2) for name, values in columns.items()}
    anna = {**each(), "name": "anna", "reward": {"column": "r", "over": over}}
    dataset = make(tmp_path, [write_csv(logs[0], twice), logs[1]], robots=[anna, "bert"])
    assert_array_equal(dataset[1].rewards, np.tile([expected, 0.0], (20, 1)))
    assert "repeated_rows" in notes(dataset)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"robots": ["anna", "anna"]}, "several robots are named anna"),
        ({"robots": [1, 2]}, "robots: got 1, expected a name, in quotes"),
        ({"episodes": {"goal_change": 1}}, "goal_change needs the goal"),
        *(({"each": each(command=command)}, message) for command, message in [
            ({"components": [{"column": "v", "low": 2, "high": 1}]}, "low is 2, expected less"),
            ({"components": [{"column": "v", "low": 2}]}, "low and high: give both, or neither"),
            ({"components": [{"column": "v"}], "differences": True}, "differences need bounds"),
        ]),
    ],
)  # fmt: skip
def test_malformed_maps(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(SpecError, match=message):
        log_map(**changes)
