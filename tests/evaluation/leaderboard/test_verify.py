"""Entries of a leaderboard: honest ones are verified, forged ones are rejected with the reason."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="policies need torch")


from swarmdata.catalogue.boards import boards  # noqa: E402
from swarmdata.catalogue.pages.results_page import results_page  # noqa: E402
from swarmdata.catalogue.result_sources import entry_sources  # noqa: E402
from swarmdata.errors import DatasetNotFoundError, SpecError  # noqa: E402
from swarmdata.evaluation.leaderboard.entry import Description, policy_name, sha256, submit  # noqa: E402
from swarmdata.evaluation.leaderboard.verify import (  # noqa: E402
    FARTHEST,
    _compared,
    fresh_seeds,
    verify,
)
from swarmdata.evaluation.results.policy_names import Target  # noqa: E402
from swarmdata.evaluation.results.result_files import Result, load_result  # noqa: E402
from swarmdata.evaluation.results.target_evaluation import evaluate_target  # noqa: E402
from swarmdata.evaluation.runs.provenance import Provenance  # noqa: E402
from swarmdata.learn.networks.perceptrons import Layer  # noqa: E402
from swarmdata.learn.policies.policy_file import save_policy  # noqa: E402
from swarmdata.learn.policies.torch_policy import TorchPolicy  # noqa: E402
from swarmdata.numerics.random import EVALUATION_BASE  # noqa: E402
from swarmdata.registry.published import published  # noqa: E402
from swarmdata.registry.recipes import find_recipe  # noqa: E402
from swarmdata.runtime.batches import Failures  # noqa: E402
from swarmdata.specs.origins import task_of  # noqa: E402
from tests.evaluation.leaderboard.conftest import change_returns  # noqa: E402
from tests.support.command_line import run  # noqa: E402

DATASET, N_SEEDS, N_EPISODES = "coop_nav-random-mini-v1", 5, 4


def network(seed: int) -> TorchPolicy:
    """A policy that was never trained."""
    spec = task_of(find_recipe(DATASET), "a test")
    rng = np.random.default_rng(seed)
    n_inputs = spec.observation_size + spec.n_agents
    weight = torch.from_numpy(rng.normal(0, 0.2, (n_inputs, spec.action_size)))
    layer = Layer(weight[None], torch.zeros(1, spec.action_size, dtype=torch.float64))
    moments = torch.zeros(spec.observation_size), torch.ones(spec.observation_size)
    mean, std = (each.double() for each in moments)
    return TorchPolicy(
        layers=(layer,), observation_mean=mean, observation_std=std, squash=True, frame=None
    )


def write_entry(folder: Path, policies: list[Any], **changes: Any) -> Path:
    """Writes an entry as `submit` does, of policies that no run holds."""
    recipe, digest = find_recipe(DATASET), published()[DATASET].digest
    for index, policy in enumerate(policies):
        save_policy(folder / policy_name(index), policy)
    hashes = tuple(sha256(folder / policy_name(index)) for index in range(len(policies)))
    one = Provenance(label="mine", algorithm="bc", dataset=DATASET, digest=digest)
    contents = ({"index": index, "content": each} for index, each in enumerate(hashes))
    found = tuple(one.model_copy(update=each) for each in contents)
    target = Target(task_of(recipe, "a test"), tuple(policies), found)
    evaluate_target(target, N_EPISODES, folder / "results", progress=False)
    description = Description(
        name="mine", dataset=DATASET, digest=digest, algorithm="bc", license="Apache-2.0",
        code="https://example.org/mine", trials=1, tuning_episodes=0, policies=hashes,
    )  # fmt: skip
    values = description.model_dump() | changes
    (folder / "entry.json").write_text(json.dumps(values))
    return folder


@pytest.fixture(scope="module")
def honest(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_entry(tmp_path_factory.mktemp("entry"), [network(seed) for seed in range(N_SEEDS)])


@pytest.fixture
def forged(honest: Path, tmp_path: Path) -> Path:
    """A copy to change."""
    return copytree(honest, tmp_path / "entry")


def change(file: Path, **changes: Any) -> None:
    file.write_text(json.dumps(json.loads(file.read_text()) | changes))


@pytest.mark.usefixtures("forked")
def test_an_honest_entry_is_verified(honest: Path) -> None:
    verdict = verify(honest, n_episodes=N_EPISODES)
    assert verdict.reasons == ()
    assert verdict.equal == 1.0
    claimed = [load_result(path) for path in (honest / "results").iterdir()]
    mean = np.mean([each.evaluation.metrics["return"] for each in claimed])
    assert verdict.reserved == pytest.approx(mean)
    assert verdict.fresh != verdict.reserved


@pytest.mark.slow
def test_another_interpreter_finds_the_same(honest: Path) -> None:
    assert verify(honest, n_episodes=N_EPISODES).is_verified


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_returns_that_were_altered_are_rejected(forged: Path) -> None:
    change_returns(forged, 1.0)
    verdict = verify(forged, n_episodes=N_EPISODES)
    assert "0.0% of the reserved episodes" in verdict.reasons[0]


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_policies_that_cannot_act_are_rejected(forged: Path) -> None:
    """Their results are those of others: what has no numbers cannot be evaluated at all."""
    broken = network(0)
    broken.layers[0].weight.fill_(torch.nan)
    old = sha256(forged / policy_name(0))
    save_policy(forged / policy_name(0), broken)
    for file in (forged / "entry.json", *(forged / "results").iterdir()):
        file.write_text(file.read_text().replace(old, sha256(forged / policy_name(0))))
    assert "could not act" in verify(forged, n_episodes=N_EPISODES).reasons[0]


def test_a_slow_entry_is_rejected(honest: Path) -> None:
    verdict = verify(honest, n_episodes=N_EPISODES, seconds=0.01)
    assert "took longer" in verdict.reasons[0]


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"digest": "0" * 64}, "has digest 000000000000"),
        ({"dataset": "coop_nav-rnadom"}, "unknown dataset"),
        ({"policies": ["0" * 64] * 5}, "1 different policies"),
        ({"trials": -1}, "trials"),
    ],
)
def test_wrong_descriptions_are_rejected(
    forged: Path, changes: dict[str, Any], reason: str
) -> None:
    change(forged / "entry.json", **changes)
    assert any(reason in each for each in verify(forged, n_episodes=N_EPISODES).reasons)


def test_wrong_files_are_rejected(forged: Path) -> None:
    (forged / "setup.py").write_text("print()")
    (forged / policy_name(1)).write_bytes((forged / policy_name(2)).read_bytes())
    (forged / policy_name(3)).unlink()
    reasons = " ".join(verify(forged, n_episodes=N_EPISODES).reasons)
    for part in ("setup.py does not belong", "policy-1.safetensors is another", "3.safetensors is"):
        assert part in reasons


@pytest.mark.parametrize("name", ["entry.json", policy_name(0), "results"])
def test_links_are_not_followed(forged: Path, name: str) -> None:
    """To a device without an end, for example."""
    moved = (forged / name).rename(forged.parent / "elsewhere")
    (forged / name).symlink_to(moved)
    assert verify(forged, n_episodes=N_EPISODES).reasons == (f"{name} is a link, expected a file",)


def test_results_of_other_episodes_are_rejected(honest: Path) -> None:
    assert "first 3 reserved" in verify(honest, n_episodes=3).reasons[0]


def test_policies_chosen_on_the_reserved_episodes_are_rejected(honest: Path) -> None:
    """Returns of five seeds that are a little better there, on 400 episodes."""
    rng = np.random.default_rng(0)
    reserved, fresh = rng.normal(0, 1, (2, N_SEEDS, 400))
    one = load_result(next((honest / "results").iterdir()))

    def claims(returns: Any) -> list[Result]:
        evaluations = (replace(one.evaluation, metrics={"return": each}) for each in returns)
        return [replace(one, evaluation=each) for each in evaluations]

    assert _compared(claims(reserved), reserved, fresh).is_verified
    error = np.sqrt((reserved.mean(0).var() + fresh.mean(0).var()) / 400)
    better = reserved + (FARTHEST + 2) * error
    assert "was chosen on the reserved ones" in _compared(claims(better), better, fresh).reasons[0]


def test_fresh_seeds_follow_from_the_policies(honest: Path) -> None:
    entry = Description.from_file(honest / "entry.json")
    seeds = fresh_seeds(entry, 100)
    assert np.array_equal(seeds, fresh_seeds(entry.model_copy(update={"name": "other"}), 100))
    swapped = entry.model_copy(update={"policies": entry.policies[::-1]})
    assert not np.intersect1d(seeds, fresh_seeds(swapped, 100)).size
    assert (seeds >= EVALUATION_BASE << 1).all()  # in no dataset, nor in a block


@pytest.mark.slow
def test_the_command_says_why(forged: Path) -> None:
    change(forged / "entry.json", digest="0" * 64)
    result = run("leaderboard", "verify", str(forged), code=1)
    assert result.startswith("rejected: its dataset has digest")


@pytest.mark.slow
def test_runs_on_other_data_make_no_entry(tiny: Path, tmp_path: Path) -> None:
    from swarmdata.evaluation.runs.train import train

    changes = {"n_updates": 1, "batch_size": 8, "hidden": 4}
    train("bc", tiny, tmp_path / "run", n_seeds=5, changes=changes, progress=False)
    options: dict[str, Any] = {"name": "m", "license": "MIT", "code": "x", "trials": 1}
    with pytest.raises(SpecError, match="expected coop_nav-random-mini-v1 as published"):
        submit([tmp_path / "run"], tmp_path / "e", DATASET, tuning_episodes=0, **options)
    assert not (tmp_path / "e").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_the_catalogue_shows_verified_entries_and_names_the_others(
    honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("good", "bad"):
        copytree(honest, tmp_path / name)
    change(tmp_path / "bad" / "entry.json", digest="0" * 64)
    short = partial(verify, n_episodes=N_EPISODES)
    monkeypatch.setattr("swarmdata.evaluation.leaderboard.verify.verify", short)
    failures = Failures(1)
    sources = entry_sources(tmp_path, failures)
    (reason,) = failures.reasons.values()
    assert "rejected: its dataset has digest 000000000000" in reason
    page = results_page(boards(sources), sources, frozenset()).body
    assert "good (verified)" in page
    assert "mine" in page
    with pytest.raises(DatasetNotFoundError, match="no entries"):
        entry_sources(tmp_path / "good", Failures(1))
