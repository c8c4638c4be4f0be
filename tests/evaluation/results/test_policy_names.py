"""Names become teams under any models; trained teams refuse what they cannot read."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="runs need the torch extra")

from swarmdata import __version__
from swarmdata.datasets.dataset import Dataset
from swarmdata.envs.world.pettingzoo import ParallelWorld
from swarmdata.errors import CheckpointError, ResultsError, SchemaError, SpecError, UnknownNameError
from swarmdata.evaluation.results.clips import draw_target
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_checks import check_results
from swarmdata.evaluation.results.result_set import group_results, reference_of
from swarmdata.evaluation.results.result_tables import case_table
from swarmdata.evaluation.results.target_evaluation import evaluate_target, kept_result
from swarmdata.evaluation.runs.generated_dataset import generate
from swarmdata.evaluation.runs.named_policies import make_policy
from swarmdata.evaluation.runs.provenance import file_name
from swarmdata.evaluation.runs.train import train
from swarmdata.hub.catalog import request
from swarmdata.hub.catalog.catalog import load
from swarmdata.learn.training.run_folder import read_run
from swarmdata.numerics.random import evaluation_seeds
from swarmdata.record import Recorder
from swarmdata.registry.components import make_env
from swarmdata.registry.presets import preset
from swarmdata.registry.published import references
from swarmdata.registry.recipes import checkpoints, side_sources, sources
from swarmdata.rollouts.rollout import rollout
from swarmdata.rollouts.side_policy import step_of_side
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.recipe import PolicySource
from swarmdata.specs.task_spec import TaskSpec
from tests.record.worlds import Counting, play, steady
from tests.support.command_line import run
from tests.support.tiny import TINY, make_tiny

pytestmark = pytest.mark.usefixtures("one_process")

HEADLINE = preset("coop_nav")


@pytest.mark.parametrize(
    ("name", "communication"),
    [("idle", "none"), ("random", "lossy-30"), ("straight", "learned-3"), ("scripted", "lossy-30")],
)
def test_scripted_policies_act_under_any_models(name: str, communication: str) -> None:
    target = find_target(name, "coop_nav", "lidar", communication)
    plain = find_target(name)
    assert target.spec == with_models(HEADLINE, "lidar", communication)
    (seen,) = evaluate_target(target, 2, progress=False)
    (base,) = evaluate_target(plain, 2, progress=False)
    if name != "random":  # whose messages use up random numbers
        one, other = seen.evaluation.metrics, base.evaluation.metrics
        assert one["return"].tolist() == other["return"].tolist()


def test_a_tier_accepts_noise_and_refuses_other_features() -> None:
    target = find_target("expert", "coop_nav", "state+noise-0.1")
    assert len(target.policies) == len(checkpoints("coop_nav", "expert"))
    assert target.spec.observation.noise.position == 0.1
    for models in (("lidar", None), (None, "perfect")):
        with pytest.raises(SchemaError, match="expert was trained with observation state, comm"):
            find_target("expert", "coop_nav", *models)


def test_a_dataset_is_its_policies_under_the_models_given() -> None:
    assert find_target("coop_nav-random", observation="bearing").spec.observation.kind == "bearing"
    with pytest.raises(SchemaError, match="coop_nav-medium was trained with"):
        find_target("coop_nav-medium", observation="bearing")


@pytest.mark.slow
def test_a_run_on_a_view_is_evaluated_under_its_models(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request, "find_recipe", lambda _: TINY)
    models: dict[str, Any] = {"observation": "lidar", "communication": "lossy-30"}
    settings = {"n_updates": "2", "hidden": "8", "batch_size": "16"}

    def train_tiny(**chosen: Any) -> None:
        train("bc", "x", tmp_path / "run", n_seeds=1, changes=settings, progress=False, **chosen)

    train_tiny(**models)
    made = read_run(tmp_path / "run")
    assert made.view is not None
    assert made.spec == with_models(TINY.spec, **models)
    with pytest.raises(CheckpointError, match="differs in: view is"):
        train_tiny()

    target = find_target(str(tmp_path / "run"))
    assert target.spec == made.spec
    (provenance,) = target.provenances
    assert (provenance.label, provenance.dataset) == ("run", "coop_nav-tiny-v0")
    assert (provenance.view, provenance.digest) == (made.view, made.digest)
    assert (provenance.updates, provenance.seed) == (2, 0)
    assert provenance.config["n_updates"] == 2
    assert find_target(str(tmp_path / "run"), **models).spec == made.spec
    harder = find_target(str(tmp_path / "run"), "coop_nav", None, "bursty-40")
    assert harder.spec.communication == communication_model("bursty-40"), "without the losses"
    assert evaluate_target(harder, 2, progress=False)[0].spec == harder.spec
    with pytest.raises(SchemaError, match="run was trained with observation lidar, communication"):
        find_target(str(tmp_path / "run"), communication="none")
    renamed = (tmp_path / "run").rename(tmp_path / "größe")
    with pytest.raises(SpecError, match="rename it: label: 'größe' is no label"):
        find_target(str(renamed))


def test_a_run_on_other_rewards_is_evaluated_on_those_of_the_task(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(request, "find_recipe", lambda _: TINY)
    line: list[object] = ["train", "bc", "x", "--out", tmp_path / "run", "--seeds", "1"]
    line += ["--updates", "2", "--set", "hidden=8", "--set", "batch_size=16", "--reward"]
    run(*line, "robot_collision=1.5", "--reward", "time=0")
    made = read_run(tmp_path / "run")
    assert made.view == '{"rewards":{"robot_collision":1.5,"time":0.0}}'
    assert made.spec == TINY.spec
    assert load("x", **json.loads(made.view)).view == made.view
    assert "differs in: view is" in run(*line, "robot_collision=1.5", code=1)
    target = find_target(str(tmp_path / "run"))
    assert target.spec == TINY.spec
    (provenance,) = target.provenances
    assert provenance.view == made.view
    assert provenance.dataset_key == provenance.dataset, "it is evaluated like any other"
    assert "unknown reward weight 'colision'" in run(*line, "colision=1", code=1)
    assert "unknown set of reward weights 'save'" in run(*line, "save", code=1)

    results = tmp_path / "results"
    (first,) = evaluate_target(target, 2, results, progress=False)
    (kept,) = evaluate_target(target, 2, results, progress=False)
    assert (first.path is None, kept.path is None) == (True, False)
    assert len(list(results.iterdir())) == 1
    check_results([kept])
    (tmp_path / "run" / "checkpoint.safetensors").write_bytes(b"trained on")
    with pytest.raises(ResultsError, match=r"have changed since they were evaluated.*\.\./run"):
        check_results([kept])
    train_again = shutil.copytree(tmp_path / "run", tmp_path / "other" / "run")
    moved = provenance.model_copy(update={"run": str(train_again)})
    with pytest.raises(ResultsError, match="two runs have the label 'run'"):
        kept_result(target.spec, moved, evaluation_seeds(2), results)


def test_what_is_there_is_not_measured_again(tmp_path: Path) -> None:
    target = find_target("random")

    def paths(**options: Any) -> list[Path | None]:
        n_episodes = options.pop("n_episodes", 2)
        found = evaluate_target(target, n_episodes, tmp_path, progress=False, **options)
        return [result.path for result in found]

    assert paths() == [None]
    (path,) = tmp_path.iterdir()
    assert paths() == [path]
    assert paths(again=True) == [None]
    assert paths(n_episodes=3) == [None]  # other episodes replace them
    assert paths(n_episodes=3, block="validation") == [None]
    assert paths(n_episodes=3, block="validation") == [path]
    assert paths(n_episodes=3) == [None]
    old = path.read_text().replace(f'"code_version":"{__version__}"', '"code_version":"0.0.1"')
    path.write_text(old)
    assert paths(n_episodes=3) == [None]
    assert paths(n_episodes=3) == [path]
    longer = target.spec.model_copy(update={"horizon": target.spec.horizon + 1})
    (provenance,) = target.provenances  # as if both specs' hashes began alike
    path.rename(tmp_path / file_name(provenance, longer.hash()))
    assert kept_result(longer, provenance, evaluation_seeds(3), tmp_path) is None


@pytest.mark.slow
def test_a_name_of_both_kinds_trains_offline_on_a_dataset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Online runs of the same name: test_training."""
    monkeypatch.setattr(request, "find_recipe", lambda _: TINY)
    settings = ("--set", "hidden=8", "--set", "batch_size=16", "--out", tmp_path / "run")
    run("train", "vdn", "x", "--updates", "2", "--seeds", "1", "--regulariser", "cql", *settings)
    assert read_run(tmp_path / "run").config["regulariser"] == "cql"
    target = find_target(str(tmp_path / "run"))
    assert target.provenances[0].dataset == "coop_nav-tiny-v0"
    assert len(evaluate_target(target, 2, progress=False)) == 1
    refused = run("train", "bc", "x", "--regulariser", "cql", "--out", "y", code=1)
    assert "unknown setting 'regulariser'" in refused


@pytest.fixture
def cached(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A generated dataset in the cache, of an id that no shipped recipe has."""
    monkeypatch.setenv("SWARMDATA_CACHE", str(tmp_path / "cache"))
    folder = tmp_path / "cache/datasets" / TINY.id
    folder.parent.mkdir(parents=True)
    return make_tiny(folder)


def test_an_own_dataset_is_its_policies(cached: Path) -> None:
    """By its id, with and without version, and by its folder; as published datasets are."""
    for name in (TINY.id, "coop_nav-tiny", str(cached)):
        target = find_target(name)
        assert (target.label, target.spec) == (TINY.id, TINY.spec)
        assert len(target.policies) == 2
        results = evaluate_target(target, 3, progress=False)
        alone = [evaluate_target(find_target(p, spec_file(cached)), 3, progress=False)[0]
                 for p in ("random", "straight")]  # fmt: skip
        for found, expected in zip(results, alone, strict=True):
            one, other = found.evaluation.metrics, expected.evaluation.metrics
            assert one["return"].tolist() == other["return"].tolist()
    with pytest.raises(SpecError, match="is a dataset, whose policies act in its own task"):
        find_target(TINY.id, "coop_nav")
    assert find_target(TINY.id, observation="bearing").spec.observation.kind == "bearing"


def spec_file(dataset: Path) -> str:
    """The task of a dataset as a file."""
    path = dataset.parent / "task.yaml"
    path.write_text(Dataset.open(dataset).task.to_yaml())
    return str(path)


@pytest.mark.slow
def test_copied_networks_of_an_own_dataset_act(tmp_path: Path) -> None:
    """They are in its folder, and the run is not needed again."""
    data = Dataset.open(make_tiny(tmp_path / "tiny"))
    few = {"n_updates": 3, "hidden": 8, "batch_size": 16}
    train("bc", tmp_path / "tiny", tmp_path / "run", n_seeds=2, changes=few, progress=False)
    generate(data.task, tmp_path / "run", id="coop_nav-mine-v0", n_steps=200,
             out=tmp_path / "mine", workers=1, progress=False)  # fmt: skip
    recorded = Dataset.open(tmp_path / "mine")
    shutil.rmtree(tmp_path / "run")
    target = find_target(str(tmp_path / "mine"))
    assert len(target.policies) == 2
    for k, policy in enumerate(target.policies):  # each acts as it did
        episode = next(each for each in recorded if each.policy == k)
        (again,) = rollout(make_env(data.task), policy, np.array([episode.seed], np.uint64))
        np.testing.assert_array_equal(again.actions, episode.actions)
    with pytest.raises(SchemaError, match="coop_nav-mine-v0 was trained with"):
        find_target(str(tmp_path / "mine"), observation="bearing")


@pytest.mark.slow
def test_datasets_without_their_policies_are_refused(
    cached: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    env = ParallelWorld(TaskSpec(horizon=10))
    with Recorder(env, id="coop_nav-byhand-v0", path=tmp_path / "byhand") as recorder:
        play(recorder, 4)
    with pytest.raises(SpecError, match="recorded without its policies mine, which therefore"):
        find_target(str(tmp_path / "byhand"))
    with Recorder(Counting(), id="counting_v1-mine-v0", path=tmp_path / "other") as recorder:
        play(recorder, 4, steady)
    with pytest.raises(SpecError, match="acting again needs a task of swarmdata"):
        find_target(str(tmp_path / "other"))
    (tmp_path / "empty").mkdir()
    with pytest.raises(SpecError, match="holds neither a training run nor a dataset"):
        find_target(str(tmp_path / "empty"))
    with pytest.raises(UnknownNameError, match="unknown policy, tier, dataset or run folder"):
        find_target("coop_nav-nothing-v0")


@pytest.mark.slow
def test_own_datasets_are_drawn(cached: Path, tmp_path: Path) -> None:
    pytest.importorskip("PIL", reason="Pillow draws")
    for name in (TINY.id, str(cached)):
        drawn = draw_target(name, tmp_path / "x.png", 1, None)
        assert drawn.seed == Dataset.open(cached)[1].seed
    with pytest.raises(SpecError, match="is a dataset, whose policies act in its own task"):
        draw_target(str(cached), tmp_path / "x.png", 0, "coop_nav")


TAG = preset("tag").with_updates(horizon=40)


@pytest.fixture(scope="module")
def tag_runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A dataset of two sides, and a run for each."""
    folder = tmp_path_factory.mktemp("tag")
    opponent = PolicySource(label="evader", name="random")
    team = (PolicySource(label="a", name="scripted", opponents=(opponent,)),)
    data = make_tiny(folder / "tag-tiny-v0", id="tag-tiny-v0", spec=TAG, policies=team)
    for side in ("pursuers", "evader"):
        out, few = folder / side, {"n_updates": 5}
        train("bc", data, out, side=side, n_seeds=2, changes=few, progress=False)
    return {"data": data, "pursuers": folder / "pursuers", "evader": folder / "evader"}


@pytest.mark.parametrize(("side", "rows"), [("pursuers", slice(0, 3)), ("evader", slice(3, 4))])
def test_a_run_of_a_side_plays_against_opponents(
    tag_runs: dict[str, Path], side: str, rows: slice
) -> None:
    target = find_target(str(tag_runs[side]), "tag", opponents="scripted")
    assert target.side is not None
    with pytest.raises(SpecError, match="in the task of its training, not in coop_nav"):
        find_target(str(tag_runs[side]), "coop_nav", opponents="scripted")
    assert target.measured.task == f"tag: {side} against scripted"
    step = make_env(TAG, 2).reset(evaluation_seeds(2))
    own = make_policy(tag_runs[side], seed=1)
    acting, scripted = target.policies[1], make_policy("scripted", TAG)
    for policy in (acting, scripted):
        policy.reset(step, np.arange(2))
    actions, expected = acting.act(step), scripted.act(step)
    seen = step_of_side(step, TAG.side(side))
    np.testing.assert_array_equal(actions[:, rows], own.act(seen))
    others = np.delete(np.arange(4), rows)
    np.testing.assert_array_equal(actions[:, others], expected[:, others])


def test_pairs_of_sides_are_independent_runs() -> None:
    """Sixteen pairs of four pursuers and four evaders are no sixteen trainings."""
    target, spec = find_target("expert", "tag"), preset("tag")
    assert len(target.policies) == len(target.provenances) == 4
    step = make_env(spec, 2).reset(evaluation_seeds(2))
    for seed, policy in enumerate(target.policies):
        policy.reset(step, np.arange(2))
        for side in spec.sides:
            alone = make_policy("expert", spec, seed=seed, side=side.name)
            seen = step_of_side(step, side)
            alone.reset(seen, np.arange(2))
            rows = slice(side.agents.start, side.agents.stop)
            np.testing.assert_array_equal(policy.act(step)[:, rows], alone.act(seen))
    assert len(find_target("tag-expert-mini").policies) == 4


def test_results_of_sides_name_them(tag_runs: dict[str, Path], tmp_path: Path) -> None:
    teams = {
        "runs": find_target(str(tag_runs["evader"]), opponents=str(tag_runs["pursuers"])),
        "greedy": find_target("tag-greedy", "tag", side="pursuers", opponents="scripted"),
    }
    for name, target in teams.items():
        found = evaluate_target(target, 4, tmp_path / name, progress=False)
        again = evaluate_target(target, 4, tmp_path / name, progress=False)
        assert [each.path for each in again] == sorted((tmp_path / name).glob("*.json"))
        (case, *rest) = (*group_results(again).cases, *group_results(again).baselines)
        assert not rest
        assert case.data is None
        is_scored = name == "greedy"  # against the scripted opponents
        columns = [column.key for column in case_table(case).columns]
        assert ("score" in columns) == (case.reference is not None) == is_scored
        assert "clean_success" in columns
        assert case.spec == target.side
        assert f"tag: {case.spec.side} against" in case_table(case).caption
        metrics = found[0].evaluation.metrics
        for metric in ("success", "return"):
            np.testing.assert_array_equal(metrics[metric], metrics[f"{case.spec.side}_{metric}"])


def test_sides_and_opponents_that_do_not_fit_are_refused(tag_runs: dict[str, Path]) -> None:
    run = str(tag_runs["pursuers"])
    no_sides = "coop_nav has one side, got side 'evader'"
    refused: list[tuple[str, str, dict[str, Any]]] = [
        (run, "was trained for the side pursuers of tag, and needs opponents", {}),
        (run, "was trained for the side pursuers, got side 'evader'", {"side": "evader"}),
        (run, "not trained for another side of tag than pursuers", {"opponents": run}),
        (run, "plays in the task of its training", {"opponents": "idle", "task": "coop_nav"}),
        ("idle", no_sides, {"side": "evader", "opponents": "idle"}),
        ("expert", no_sides, {"side": "evader", "opponents": "idle"}),
        ("coop_nav-medium", "is of a whole team and does not take", {"opponents": "idle"}),
        (
            "idle",
            r"got side \(--side\) 'evader' and opponents \(--opponents\) None for idle",
            {"task": "tag", "side": "evader"},
        ),
    ]
    for name, words, arguments in refused:
        with pytest.raises(SpecError, match=words):
            find_target(name, **arguments)
    with pytest.raises(UnknownNameError, match="tier or run folder of a side 'ilde'"):
        find_target(run, opponents="ilde")
    with pytest.raises(SpecError, match="was trained for the side pursuers of tag, and does not"):
        make_policy(run, TAG)
    with pytest.raises(SchemaError, match=r"has the rows of all sides .* bc learns for one"):
        train("bc", tag_runs["data"], tag_runs["data"].parent / "x", progress=False)


def test_tiers_play_a_side_or_against_one() -> None:
    task = preset("tag")
    target = find_target("expert", "tag", side="pursuers", opponents="scripted")
    assert target.measured == SideSpec(whole=task, side="pursuers", opponents="scripted")
    assert len(target.policies) == len(side_sources("tag", "expert", "pursuers")) > 1
    whole = find_target("expert", "tag")
    assert whole.side is None
    assert len(whole.policies) == len(target.policies) < len(sources("tag", "expert"))
    assert len({each.content for each in whole.provenances}) == len(whole.policies)
    first = find_target("scripted", "tag", side="pursuers", opponents="medium").measured
    assert isinstance(first, SideSpec)
    digest = str(side_sources("tag", "medium", "evader")[0].sha256)
    assert first.opponents == f"medium@{digest[:8]}"
    step = make_env(task, 2).reset(np.arange(2, dtype=np.uint64))
    learned, other = target.policies[0], whole.policies[0]
    for policy in (learned, other):
        policy.reset(step, np.arange(2))
    np.testing.assert_array_equal(learned.act(step)[:, :3], other.act(step)[:, :3])


def test_a_side_has_a_score_against_the_opponents_of_its_references() -> None:
    scripted, learned = (
        SideSpec(whole=preset("tag"), side="evader", opponents=name)
        for name in ("scripted", "medium@12345678")
    )
    known = references()["tag-evader"]
    assert reference_of(scripted) == known.reference
    assert reference_of(learned) is None
    noisy = with_models(scripted.whole, observation="noise-0.05")
    assert reference_of(scripted.model_copy(update={"whole": noisy})) == known.reference


def test_the_command_line_trains_and_evaluates_sides(
    tag_runs: dict[str, Path], tmp_path: Path
) -> None:
    out = tmp_path / "run"
    run("train", "bc", tag_runs["data"], "--side", "evader", "--seeds", "1", "--updates", "3",
        "--out", out)  # fmt: skip
    assert "tag: evader against tag-greedy" in run(
        "evaluate", out, "--opponents", "tag-greedy", "--episodes", "2"
    )
    assert "tag: pursuers against idle" in run(
        "evaluate", "random", "--task", "tag", "--side", "pursuers", "--opponents", "idle",
        "--episodes", "2",
    )  # fmt: skip
    small = ("--steps", "64", "--set", "n_copies=4", "--set", "rollout_steps=8", "--set",
             "hidden=8", "--set", "frame=auto", "--seeds", "1", "--checkpoints", "1")  # fmt: skip
    run("train-online", "dagger", "tag", "--side", "pursuers", "--opponents", out, *small, "--out",
        tmp_path / "online")  # fmt: skip
    assert "tag: pursuers against run@" in run(
        "evaluate", tmp_path / "online", "--opponents", out, "--episodes", "2"
    )
