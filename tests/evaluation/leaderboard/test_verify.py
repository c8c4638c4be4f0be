"""Entries of a leaderboard: honest ones are verified, forged ones are rejected with the reason."""

import json
import re
from dataclasses import replace
from functools import partial
from pathlib import Path
from shutil import copytree
from typing import Any, NamedTuple

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
from swarmdata.types import Double  # noqa: E402
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


class Tables(NamedTuple):
    """What was evaluated, [K, E], and results whose metrics can be replaced."""

    metrics: dict[str, Double]
    results: list[Result]

    def claims(self, **changes: Double) -> list[Result]:
        """Results that claim the metrics, or others."""
        said = self.metrics | changes
        seeds = np.arange(self.metrics["return"].shape[1], dtype=np.uint64)
        rows = ({name: values[k] for name, values in said.items()} for k in range(N_SEEDS))
        evaluations = (replace(self.results[0].evaluation, seeds=seeds, metrics=r) for r in rows)
        found = zip(self.results, evaluations, strict=True)
        return [replace(each, evaluation=evaluation) for each, evaluation in found]


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


def change_result(entry: Path, index: int, **changes: Any) -> None:
    """Changes metrics of one policy: to what a function makes of them, [E]."""
    for file in (entry / "results").iterdir():
        document = json.loads(file.read_text())
        if document["provenance"]["index"] == index:
            metrics = document["metrics"]
            metrics |= {name: edit(np.array(metrics[name])) for name, edit in changes.items()}
            file.write_text(json.dumps(document))


def with_first(value: float) -> Any:
    return lambda old: [value, *old[1:].tolist()]


@pytest.mark.slow
@pytest.mark.usefixtures("forked")
def test_one_value_that_rounding_does_not_explain_is_rejected(forged: Path) -> None:
    """The robots drove as it says; the message names the value."""
    change_result(forged, 2, **{"return": with_first(9.0)})
    change_result(forged, 3, robot_collisions=with_first(77.0))
    one, two = verify(forged, n_episodes=N_EPISODES).reasons[-2:]
    assert "its return differs in 1 of 20 episodes" in one
    assert f"policy 2 (training seed None) in the episode of seed {EVALUATION_BASE}" in one
    assert "return 9 claimed, " in one
    assert "robot_collisions 77 claimed, " in two


@pytest.mark.parametrize(
    ("name", "value"), [("algorithm", "iql"), ("dataset", "coop_nav-expert-v1"), ("run", "../mine")]
)
def test_results_said_to_be_of_others_are_rejected(forged: Path, name: str, value: str) -> None:
    file = next((forged / "results").iterdir())
    document = json.loads(file.read_text())
    document["provenance"][name] = value
    file.write_text(json.dumps(document))
    (reason,) = verify(forged, n_episodes=N_EPISODES).reasons
    assert f"has {name} '{value}', expected" in reason


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


@pytest.mark.usefixtures("forked")
def test_copies_of_one_policy_in_other_files_are_rejected(tmp_path: Path) -> None:
    one = network(0)
    layer = one.layers[0]
    shifts = np.arange(N_SEEDS) * 1e-12
    copies = [replace(one, layers=(layer._replace(bias=layer.bias + each),)) for each in shifts]
    verdict = verify(write_entry(tmp_path / "entry", copies), n_episodes=N_EPISODES)
    (reason,) = verdict.reasons
    assert "its policies 0 and 1 end 100% of the episodes with the same metrics" in reason


@pytest.mark.parametrize("content", [r"\g<0>", '"content":null'])
def test_further_results_are_rejected(forged: Path, content: str) -> None:
    """A second one of a policy, or one of nobody."""
    (first, *_) = sorted((forged / "results").iterdir())
    text = re.sub(r'"content":"\w+"', content, first.read_text())
    (forged / "results" / "00.json").write_text(text)
    (reason,) = verify(forged, n_episodes=N_EPISODES).reasons
    assert "results has 6 results of 5 policies, expected one of each" in reason


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


@pytest.fixture
def tables(honest: Path) -> Tables:
    """Honest evaluations of five policies on 1,000 episodes, and the results that claim them."""
    rng = np.random.default_rng(0)
    solved = (rng.random((N_SEEDS, 1000)) < 0.7).astype(np.float64)
    metrics = {
        "return": rng.normal(0, 1, solved.shape) + 8 * solved,
        "success": solved,
        "robot_collisions": rng.poisson(0.4, solved.shape).astype(np.float64),
        "time_to_goal": np.where(solved, rng.uniform(2, 9, solved.shape), np.nan),
        "path_length": rng.uniform(2, 9, solved.shape),
    }
    files = (honest / "results").iterdir()
    return Tables(metrics, sorted(map(load_result, files), key=lambda r: r.provenance.index))


def test_policies_chosen_on_the_reserved_episodes_are_rejected(tables: Tables) -> None:
    """Returns of five seeds that are a little better there."""
    fresh = {"return": np.random.default_rng(1).permuted(tables.metrics["return"], axis=1)}
    assert _compared(tables.claims(), tables.metrics, fresh).is_verified
    returns = tables.metrics["return"]
    error = np.sqrt((returns.mean(0).var() + fresh["return"].mean(0).var()) / 1000)
    better = {"return": returns + (FARTHEST + 2) * error}
    verdict = _compared(tables.claims(**better), tables.metrics | better, fresh)
    (reason,) = verdict.reasons
    assert "was chosen on the reserved ones" in reason


ROUNDED = 30
"""Episodes of each policy that end otherwise on another processor, of 1,000."""


def test_rounding_is_allowed_and_what_was_evaluated_is_published(tables: Tables) -> None:
    """Episodes that went otherwise, in both directions, one of them with an impossible return."""
    again = {name: values.copy() for name, values in tables.metrics.items()}
    for values in again.values():
        values[:, :ROUNDED] = values[:, -ROUNDED:]  # of other episodes
    again["return"][0, 0] = 900.0
    verdict = _compared(tables.claims(**again), tables.metrics, tables.metrics)
    assert verdict.reasons == ()
    assert verdict.equal == pytest.approx(1 - ROUNDED / 1000)
    for k, result in enumerate(verdict.results):
        for name, values in tables.metrics.items():
            np.testing.assert_array_equal(result.evaluation.metrics[name], values[k])


@pytest.mark.parametrize("is_onnx", [False, True])
@pytest.mark.parametrize("hides_it", [False, True])
def test_worst_episodes_that_were_bettered_are_rejected(
    tables: Tables, *, hides_it: bool, is_onnx: bool
) -> None:
    """40 of 1,000, fewer than rounding may change; a path that was altered too does not help."""
    said = {name: values.copy() for name, values in tables.metrics.items()}
    for k, worst in enumerate(np.argsort(said["return"], axis=1)[:, :40]):
        said["return"][k, worst] = 7.0
        said["path_length"][k, worst] += 1e-9 * hides_it
    claims = tables.claims(**said)
    (reason,) = _compared(claims, tables.metrics, tables.metrics, is_onnx=is_onnx).reasons
    assert ("off on average" if hides_it else "differs in 200 of 5,000 episodes") in reason
    lowest = tables.metrics["return"].min()
    assert f"return 7 claimed, {lowest:.6g} evaluated" in reason


def test_claims_of_success_and_of_no_collisions_are_rejected(tables: Tables) -> None:
    said = {"success": np.ones((N_SEEDS, 1000)), "robot_collisions": np.zeros((N_SEEDS, 1000))}
    reasons = _compared(tables.claims(**said), tables.metrics, tables.metrics).reasons
    assert "of the reserved episodes ended with the metrics that it says" in reasons[0]
    for name, reason in zip(said, reasons[1:], strict=True):
        assert f"its {name} differs in" in reason
    assert "success 1 claimed, 0 evaluated" in reasons[1]


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
def test_the_catalogue_shows_what_was_evaluated_and_names_rejected_entries(
    honest: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("bad", "good", "its-copy"):
        copytree(honest, tmp_path / name)
    change(tmp_path / "its-copy" / "entry.json", license="another")
    change(tmp_path / "bad" / "entry.json", digest="0" * 64)
    metrics = [load_result(file).evaluation.metrics for file in (honest / "results").iterdir()]
    hidden = {"path_length": lambda old: [old[0] + 1e-9, *old[1:]]}  # as if rounded
    change_result(tmp_path / "good", 2, **hidden, **{"return": with_first(9000.0)})
    short = partial(verify, n_episodes=N_EPISODES)
    monkeypatch.setattr("swarmdata.evaluation.leaderboard.verify.verify", short)
    failures = Failures(1)
    sources = entry_sources(tmp_path, failures)
    reason, copied = failures.reasons.values()
    assert "rejected: its dataset has digest 000000000000" in reason
    assert f"as one of {tmp_path / 'good'} does: one of the two entries is a copy" in copied
    page = results_page(boards(sources), sources, frozenset()).body
    assert "good (verified)" in page
    (source,) = sources
    (outcome,) = source.outcomes
    assert outcome.label == "mine"
    mean = np.mean([each["return"] for each in metrics])
    assert outcome.estimates["return"].value == pytest.approx(mean)  # not what was claimed
    with pytest.raises(DatasetNotFoundError, match="no entries"):
        entry_sources(tmp_path / "good", Failures(1))
