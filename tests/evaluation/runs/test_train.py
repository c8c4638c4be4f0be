"""Training as the command line does it: settings, folders, processes, and wrong usage."""

import json
import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="training needs the torch extra")

from swarmdata.errors import BuildError, CheckpointError, SchemaError, SpecError, UnknownNameError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_files import load_result
from swarmdata.evaluation.results.target_evaluation import evaluate_target
from swarmdata.evaluation.runs.algorithm_choice import choose_for
from swarmdata.evaluation.runs.train import read_settings, train, train_online
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.policies.policy_file import last_policy
from swarmdata.learn.training.run_files import read_table, run_hash
from swarmdata.learn.training.run_folder import read_run
from swarmdata.learn.training.settings import from_json, override
from swarmdata.online_algos.dagger import DAggerConfig
from swarmdata.online_algos.mappo import MAPPOConfig
from swarmdata.online_algos.runs.online_training import read_online_run
from swarmdata.perception.frames import find_frame
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, make_env, resolve
from swarmdata.registry.presets import preset, preset_names
from swarmdata.registry.published import Reference
from swarmdata.registry.recipes import checkpoints
from swarmdata.registry.tiers import LEARNED_FAMILIES
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from tests.support.command_line import run
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY, make_tiny

CONFIGS = sorted(
    Path(file.name).stem for file in (files("swarmdata.online_algos") / "configs").iterdir()
)
SMALL = {"n_copies": "4", "rollout_steps": "4", "hidden": "8", "minibatch": "64"}


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few episodes measure a checkpoint, and there is one checkpoint unless a test says more."""
    from swarmdata.evaluation.runs import train
    from swarmdata.online_algos.runs.online_training import describe_run

    def describe(*arguments: Any, **options: Any) -> Any:
        n_checkpoints = options["n_checkpoints"]
        options["n_checkpoints"] = 1 if n_checkpoints == 40 else n_checkpoints
        return describe_run(*arguments, n_episodes=2, **options)

    monkeypatch.setattr(train, "describe_run", describe)


@pytest.fixture
def task(tmp_path: Path) -> Path:
    """A spec's file."""
    file = tmp_path / "short.yaml"
    file.write_text(TaskSpec(horizon=10).to_yaml())
    return file


def settings() -> list[str]:
    return [word for key, value in SMALL.items() for word in ("--set", f"{key}={value}")]


@pytest.mark.parametrize("name", CONFIGS)
def test_shipped_settings_are_settings_for_their_task(name: str) -> None:
    changes = read_settings(name)
    defaults = DAggerConfig() if "teacher" in changes else MAPPOConfig()
    config: Any = override(defaults, changes)
    assert config != defaults
    is_clone = "teacher" in changes or config.critic_warmup_fraction == 1
    assert config.n_steps >= 50_000 or is_clone  # clones are short
    task = max((each for each in preset_names() if name.startswith(f"{each}-")), key=len)
    spec = preset(task)
    frame = find_frame(make_env(spec, 1).features, config.frame, spec.robots)
    assert (frame is None) == (config.frame == "world")


def test_the_shipped_experts_have_settings() -> None:
    trained = {family for family in LEARNED_FAMILIES if checkpoints(family, "expert")}
    of_coop_nav = {"coop_nav-n8", "coop_nav-corridor-strict"}  # with its settings
    of_defaults = {"coop_nav-swap-strict"}
    of_sides = {"tag"}  # each has its own
    named = trained - of_coop_nav - of_defaults - of_sides
    assert {f"{family}-expert" for family in named} <= set(CONFIGS)


def test_settings_are_read_as_the_command_line_takes_them(tmp_path: Path) -> None:
    file = tmp_path / "own.yaml"
    file.write_text(
        "n_steps: 5000\nhidden: 8\n"
        "shaping:\n  contact_ramp: [-1.0, 0]\nstart:\n  teacher_remembers: false\n"
    )
    config = override(MAPPOConfig(), read_settings(str(file)))
    assert (config.n_steps, config.hidden) == (5000, 8)
    assert config.shaping.contact_ramp == (-1.0, 0.0)
    assert not config.start.teacher_remembers


def test_wrong_settings_are_errors(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'coop_nav-expert'"):
        read_settings("coop_nav-expart")
    with pytest.raises(UnknownNameError, match="unknown settings"):
        read_settings(str(tmp_path / "absent.yaml"))
    file = tmp_path / "list.yaml"
    file.write_text("- hidden\n")
    with pytest.raises(SpecError, match="holds list, expected a table"):
        read_settings(str(file))
    with pytest.raises(UnknownNameError, match="Did you mean 'hidden'"):
        override(MAPPOConfig(), {"hidde": "8"})


@pytest.mark.slow
def test_auto_says_and_trains_what_it_chooses(tiny: Path, tmp_path: Path) -> None:
    """In the tiny dataset, `straight` is far better than `random`, and nothing is solved."""
    choice = choose_for(load(tiny))
    sizes = ("--seeds", "1", "--updates", "2", "--set", "batch_size=8")
    assert choice.line in run("train", "auto", tiny, "--out", tmp_path / "run", *sizes)
    made = read_run(tmp_path / "run")
    assert made.algorithm == choice.algorithm
    kind = resolve("algorithm", OFFLINE_ALGORITHMS, choice.algorithm)
    expected = override(kind.Config(), {"n_updates": "2", "batch_size": "8"})
    assert from_json(kind.Config, made.config) == expected
    again = run("train", "auto", tiny, "--out", tmp_path / "run", *sizes)  # nothing is left to do
    assert again.splitlines()[-1] == str(tmp_path / "run")


@pytest.mark.parametrize(
    ("line", "code", "message"),
    [
        ("train mappo coop_nav-random", 2, "swarmdata train-online mappo TASK"),
        ("train-online bc coop_nav", 2, "swarmdata train bc ID"),
        ("train-online mappo coop_nav --set hidden", 2, "expected KEY=VALUE"),
        ("train bc coop_nav-random --updates 5 --set n_updates=7", 2, "n_updates is both 5 and 7"),
        ("train-online mappo coop_nav --set hidden=8 --set hidden=9", 2, "is both 8 and 9"),
        ("train-online mapo coop_nav", 1, "Did you mean 'mappo'"),
        ("train-online mappo coop_nv", 1, "Did you mean 'coop_nav'"),
        ("train-online mappo coop_nav --set hidde=8", 1, "Did you mean 'hidden'"),
        ("train-online mappo coop_nav --config x", 1, "unknown settings 'x'"),
    ],
)
def test_wrong_usage_makes_no_folder(line: str, code: int, message: str, tmp_path: Path) -> None:
    output = run(*line.split(), "--out", tmp_path / "run", code=code)
    assert message in " ".join(output.split())
    assert not (tmp_path / "run").exists()


def test_one_command_trains_goes_on_and_is_evaluated(task: Path, tmp_path: Path) -> None:
    out, file = tmp_path / "run", tmp_path / "own.yaml"
    file.write_text("hidden: 16\nn_steps: 16\n")
    command: tuple[str | Path, ...] = (
        "train-online", "mappo", task, "--seeds", "2", "--first-seed", "5", "--steps", "3.2e1",
        "--config", file, "--out", out, "--checkpoints", "2", *settings(),
    )  # fmt: skip
    assert run(*command).endswith(f"{out}\n")  # after progress of compiling
    assert read_online_run(out).n_checkpoints == 2
    curve = (out / "curve.csv").read_bytes()
    run(*command)
    assert (out / "curve.csv").read_bytes() == curve
    assert read_online_run(out).seeds == (5, 6)
    config = read_online_run(out).config
    assert (config["hidden"], config["n_steps"]) == (8, 32)  # --set wins, --steps too
    results = tmp_path / "results"
    run("evaluate", out, "--episodes", "2", "--out", results)
    written = [load_result(file) for file in sorted(results.iterdir())]
    assert [each.provenance.seed for each in written] == [5, 6]
    assert {each.provenance.frames for each in written} == {32}
    assert written[0].spec == TaskSpec(horizon=10)


@pytest.mark.parametrize("algorithm", ONLINE_ALGORITHMS)
def test_a_run_of_any_algorithm_is_a_target(algorithm: str, task: Path, tmp_path: Path) -> None:
    kind = resolve("algorithm", ONLINE_ALGORITHMS, algorithm)
    replay = {"batch_size": "4", "capacity": "64", "margin": "64", "warmup_transitions": "8"}
    known = kind.Config.__dataclass_fields__
    changes = {k: v for k, v in {**SMALL, **replay, "n_steps": "32"}.items() if k in known}
    out = tmp_path / "run"
    train_online(algorithm, str(task), out, seeds=(4, 2), changes=changes, progress=False)
    target = find_target(str(out))
    assert target.label == "run"
    assert target.spec == TaskSpec(horizon=10)
    assert {each.algorithm for each in target.provenances} == {algorithm}
    assert [each.seed for each in target.provenances] == [4, 2]
    contents = [run_hash(out, seed) for seed in (4, 2)]
    assert [each.content for each in target.provenances] == contents
    step = make_env(target.spec, 3).reset(np.arange(3, dtype=np.uint64))
    for seed, policy in zip((4, 2), target.policies, strict=True):
        np.testing.assert_array_equal(policy.act(step), last_policy(out, seed).act(step))
    assert len(evaluate_target(target, 2, progress=False)) == 2
    with pytest.raises(SchemaError, match="was trained with observation state"):
        find_target(str(out), observation="lidar")


def test_robots_may_learn_under_other_models(task: Path, tmp_path: Path) -> None:
    changes = {**SMALL, "n_steps": "16", "frame": "world"}
    out = tmp_path / "run"
    name = "lidar+delay-1"
    train_online(
        "mappo", str(task), out, seeds=(0,), changes=changes, observation=name, progress=False
    )
    seen = with_models(TaskSpec(horizon=10), name, None)
    assert find_target(str(out)).spec == seen
    assert find_target(str(out), observation=name).spec == seen, "names modify the task's models"


def test_data_are_mixed_in_as_the_task_is_seen(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names would modify what was recorded, which may differ from the task's own models."""
    spec = with_models(TaskSpec(horizon=10), None, "goal+lossy-30")
    task = tmp_path / "task.yaml"
    task.write_text(spec.to_yaml())

    def opened(_: Any, __: Any, options: dict[str, Any]) -> None:
        raise SpecError(f"{options['observation']}, {options['communication']!r}")

    monkeypatch.setattr("swarmdata.evaluation.runs.train.open_data", opened)
    asked = f"None, {with_models(spec, None, 'delayed-2').communication!r}"
    with pytest.raises(SpecError, match=re.escape(asked)):
        train_online("vdn", str(task), tmp_path / "run", data="a", communication="delayed-2")


def test_seeds_are_jobs_and_their_failures_are_told(task: Path, tmp_path: Path) -> None:
    changes, out = {**SMALL, "n_steps": "16"}, tmp_path / "run"

    def train(**other: str) -> None:
        with ThreadPoolExecutor(1) as engine:
            train_online(
                "mappo", str(task), out, seeds=(0, 2), changes=changes | other, engine=engine,
                progress=False,
            )  # fmt: skip

    train()
    assert sorted(path.name for path in out.iterdir()) == ["seeds-0", "seeds-2"]
    whole = find_target(str(out))
    assert (whole.label, len(whole.policies)) == ("run", 2)
    assert [(each.seed, Path(str(each.run)).name) for each in whole.provenances] == [
        (0, "seeds-0"), (2, "seeds-2"),
    ]  # fmt: skip
    train_online("mappo", str(task), tmp_path / "alone", seeds=(2,), changes=changes)
    step = make_env(TaskSpec(horizon=10), 3).reset(np.arange(3, dtype=np.uint64))
    alone = last_policy(tmp_path / "alone", 2).act(step)
    np.testing.assert_array_equal(last_policy(out, 2).act(step), alone)
    shutil.rmtree(out / "seeds-2")
    with pytest.raises(BuildError, match="2 of 2 groups of seeds failed: seeds-0 of run") as told:
        train(hidden="16")
    assert "holds another run, which differs in: config" in str(told.value)
    assert "seeds-0 holds other seeds of the run that" in str(told.value), "seeds-2 is not begun"
    with pytest.raises(BuildError, match="was trained with other groups of seeds"):
        train_online("mappo", str(task), out, seeds=(0, 2), changes=changes)


@pytest.mark.slow
def test_a_mixture_is_trained_on_and_evaluated(tmp_path: Path) -> None:
    """The run's description says what was mixed; a killed run goes on with it."""
    with pytest.MonkeyPatch.context() as patch:
        use_one_process(patch)
        first = make_tiny(tmp_path / "first")
        second = make_tiny(tmp_path / "second", id="coop_nav-other-v0", seed=6)
    out = tmp_path / "run"
    command: tuple[str | Path, ...] = (
        "train", "bc", f"{first}=0.8,{second}=0.2", "--updates", "4", "--seeds", "1", "--out", out,
        "--set", "hidden=8", "--set", "batch_size=8", "--reward", "safe",
    )  # fmt: skip
    run(*command)
    described = read_run(out)
    assert described.dataset == "coop_nav-tiny-v0+coop_nav-other-v0"
    assert described.view is not None
    mixed = json.loads(described.view)["mixture"]
    assert [part["weight"] for part in mixed] == [0.8, 0.2]
    assert all("proximity" in part["view"] for part in mixed)
    checkpoint = (out / "checkpoint.safetensors").read_bytes()
    run(*command)
    assert (out / "checkpoint.safetensors").read_bytes() == checkpoint
    run("evaluate", out, "--episodes", "2", "--out", tmp_path / "results")
    (file,) = (tmp_path / "results").iterdir()
    provenance = load_result(file).provenance
    assert (provenance.dataset, provenance.digest) == (described.dataset, described.digest)
    output = run("train", "bc", f"{first}=0.8,{second}", code=2)
    assert "has no number for each dataset" in " ".join(output.replace("\u2502", " ").split())


def test_online_training_begins_with_an_offline_run_and_mixes_data(
    tiny: Path, tmp_path: Path
) -> None:
    offline, out = tmp_path / "offline", tmp_path / "run"
    small = {"hidden": 8, "batch_size": 8, "n_updates": 4}
    train("bc", tiny, offline, n_seeds=1, changes=small, progress=False)
    changes = {
        "n_copies": 4, "rollout_steps": 4, "batch_size": 8, "capacity": 64, "margin": 64,
        "warmup_transitions": 8, "n_steps": 16,
    }  # fmt: skip
    with ThreadPoolExecutor(1) as engine:  # all of it travels to another process
        train_online(
            "maddpg", TINY.spec, out, seeds=[0], changes=changes, start=offline, data=tiny,
            offline_share=0.25, engine=engine, progress=False,
        )  # fmt: skip
    description = read_online_run(out / "seeds-0")
    assert description.start is not None
    assert description.start.folder == str(offline)
    assert description.recorded is not None
    assert description.recorded.share == 0.25
    assert description.config["actor_hidden"] == [8]


def test_training_ends_with_the_score_of_its_last_evaluation_and_that_of_the_data(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from swarmdata.evaluation.runs import train as module

    data = replace(load(tiny), references=Reference(-20.0, 10.0))
    monkeypatch.setattr(module, "open_data", lambda *_: data)
    out = tmp_path / "run"
    sizes = ("--seeds", "2", "--updates", "4", "--set", "hidden=8", "--set", "batch_size=8")
    text = run("train", "bc", tiny, "--out", out, *sizes, "--curve-every", "3")

    rows = [row for row in read_table(out / "curve.csv") if row["update"] == 4]
    assert len(rows) == 2
    score = data.normalized_score(sum(row["return"] for row in rows) / 2)
    own = data.normalized_score([data.episodes.team_return.mean()])[0]
    line, folder = text.splitlines()[-2:]
    assert line.startswith(f"After 4 updates, 2 seeds have a mean score of {score:.1f}, and ")
    assert line.endswith(f"the data have {own:.1f} ({TINY.id}).")
    assert folder == str(out)


def test_training_without_references_ends_with_returns(tiny: Path, tmp_path: Path) -> None:
    """No references of the tiny task are known, and a recording has no learning curve."""
    from swarmdata.evaluation.runs.train import last_evaluation

    (tmp_path / "config.json").write_text("{}")
    assert last_evaluation(tmp_path, str(tiny), None) is None
    (tmp_path / "curve.csv").write_text("update,seed,return,success\n1,0,2.0,0.5\n")
    own = load(tiny).episodes.team_return.mean()
    assert last_evaluation(tmp_path, str(tiny), None) == (
        f"After 1 updates, 1 seed has a mean return of 2, and 50% success in 64 validation "
        f"episodes; the data have {own:.3g} ({TINY.id})."
    )


def test_a_device_that_is_not_here_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="torch has no device 'cuda:99' here, expected cpu, or"):
        train("bc", "coop_nav-random-mini", tmp_path / "run", device="cuda:99")
    assert not list(tmp_path.iterdir())


def test_rewards_of_a_function_are_learned_from_and_noted(tiny: Path, tmp_path: Path) -> None:
    out, changes = tmp_path / "run", {"n_updates": 2, "batch_size": 4}
    rewards = "tests.support.own_rewards:effort"
    train("iql", tiny, out, n_seeds=1, changes=changes, rewards=rewards, progress=False)
    (provenance,) = find_target(str(out)).provenances
    assert provenance.changes["rewards"]["function"] == "effort"
    with pytest.raises(CheckpointError, match="holds another run"):
        train("iql", tiny, out, n_seeds=1, changes=changes, progress=False)


def test_settings_may_be_of_their_own_types(tiny: Path, tmp_path: Path) -> None:
    native = {"n_updates": 2.0, "hidden": [8, 4], "memory": None, "learning_rate": 1e-3}
    text = {"n_updates": "2", "hidden": "8,4", "memory": "none", "learning_rate": "0.001"}
    runs = []
    for name, changes in (("a", native), ("b", text)):
        train("bc", tiny, tmp_path / name, n_seeds=1, changes=changes, progress=False)
        runs.append(read_run(tmp_path / name))
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"changes": {"n_updates": 2.5}}, "n_updates.* got '2.5', expected a whole number"),
        ({"changes": {"hidden": object()}}, "expected values separated by commas"),
        ({"curve_every": "often"}, "arguments of train: curve_every"),
        ({"n_seeds": 0}, "n_seeds is 0, expected a whole number of at least 1"),
        ({"n_seeds": "3"}, "n_seeds is '3', expected a whole number"),
    ],
)
def test_arguments_of_another_type_are_refused(
    tiny: Path, tmp_path: Path, arguments: dict[str, Any], message: str
) -> None:
    with pytest.raises(SpecError, match=message):
        train("bc", tiny, tmp_path / "run", **arguments)
    assert not (tmp_path / "run").exists()


def test_online_training_takes_specs_and_refuses_seeds_that_are_none(tmp_path: Path) -> None:
    spec, changes = TaskSpec(horizon=10), {**SMALL, "n_steps": 40.0}
    train_online("mappo", spec, tmp_path / "run", seeds=[0], changes=changes, progress=False)
    assert read_online_run(tmp_path / "run").spec == spec
    for seeds in ([], ["a"], [-1], [0, 1, 1]):
        with pytest.raises(SpecError, match="expected different whole numbers from 0 on"):
            train_online("mappo", spec, tmp_path / "other", seeds=seeds, changes=changes)  # type: ignore[arg-type]


def test_online_training_ends_with_what_its_newest_policies_do(tmp_path: Path) -> None:
    from swarmdata.evaluation.runs.train import last_online_evaluation

    (tmp_path / "config.json").write_text("{}")
    assert last_online_evaluation(tmp_path) is None
    rows = "frames,seed,success,return\n64,0,0,-3\n96,0,0.25,1.5\n96,1,0.5,2.5\n"
    (tmp_path / "curve.csv").write_text(rows)
    assert last_online_evaluation(tmp_path) == (
        "After 96 joint steps, 2 seeds have a mean return of 2, and 38% success in validation "
        "episodes."
    )
