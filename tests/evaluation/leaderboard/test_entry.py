"""Making an entry: what is submitted, and what is left if it fails or is interrupted."""

import os
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="policies need torch")

from swarmdata.errors import FileKindError, SpecError
from swarmdata.evaluation.leaderboard import entry as entries
from swarmdata.evaluation.leaderboard.entry import sha256, submit
from swarmdata.evaluation.leaderboard.verify import verify
from swarmdata.evaluation.results.policy_names import Target
from swarmdata.evaluation.runs.provenance import Provenance
from swarmdata.registry.published import published
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.origins import task_of
from tests.evaluation.leaderboard.test_verify import DATASET, N_EPISODES, N_SEEDS, network

ABOUT: dict[str, Any] = {
    "license": "MIT", "code": "https://example.org", "trials": 1, "tuning_episodes": 0,
    "n_episodes": N_EPISODES, "progress": False,
}  # fmt: skip


@pytest.fixture
def configs(monkeypatch: pytest.MonkeyPatch) -> dict[str, dict[str, Any]]:
    """Runs with these settings are found: `first` has all seeds but one, `second` the last."""
    found: dict[str, dict[str, Any]] = {"first": {"hidden": 64}, "second": {"hidden": 64}}
    spec, digest = task_of(find_recipe(DATASET), "a test"), published()[DATASET].digest

    def find(run: str) -> Target:
        seeds = range(N_SEEDS - 1) if run == "first" else [N_SEEDS - 1]
        one = Provenance(label="bc", algorithm="bc", dataset=DATASET, digest=digest, run=run)
        about = tuple(one.model_copy(update={"seed": seed, "config": found[run]}) for seed in seeds)
        return Target(spec, tuple(map(network, seeds)), about)

    monkeypatch.setattr(entries, "find_target", find)
    return found


@pytest.mark.usefixtures("forked")
@pytest.mark.usefixtures("configs")
def test_what_was_interrupted_is_submitted_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also under another name: nothing of an earlier entry is left."""
    runs, out = [Path("first"), Path("second")], tmp_path / "entry"

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(entries, "evaluate_target", interrupted)
        with pytest.raises(KeyboardInterrupt):
            submit(runs, out, DATASET, name="mine", **ABOUT)
    for name in ("mine", "renamed"):
        submit(runs, out, DATASET, name=name, **ABOUT)
    verdict = verify(out, n_episodes=N_EPISODES)
    assert verdict.reasons == ()
    assert {result.provenance.label for result in verdict.results} == {"renamed"}


@pytest.mark.usefixtures("configs")
def test_a_name_that_is_not_allowed_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"name: expected text .* \(got 'a/b'\)"):
        submit([Path("first"), Path("second")], tmp_path / "entry", DATASET, name="a/b", **ABOUT)
    assert not any(tmp_path.iterdir())


def test_runs_with_other_settings_are_refused(
    configs: dict[str, dict[str, Any]], tmp_path: Path
) -> None:
    configs["second"] = {"hidden": 32}
    with pytest.raises(SpecError, match=r"second \(bc\) and first \(bc\) differ in"):
        submit([Path("first"), Path("second")], tmp_path / "entry", DATASET, name="m", **ABOUT)


@pytest.mark.usefixtures("configs")
def test_an_entry_that_is_too_large_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nor evaluated, where its policies alone are."""
    runs = [Path("first"), Path("second")]
    monkeypatch.setattr(entries, "evaluate_target", None)
    monkeypatch.setattr(entries, "LARGEST", 10_000)
    with pytest.raises(SpecError, match=r"refused: it has 0\.\d MB, expected at most 0\. Submit"):
        submit(runs, tmp_path / "entry", DATASET, name="mine", **ABOUT)
    assert not any(tmp_path.iterdir())


def test_neither_a_pipe_nor_a_huge_file_is_read(tmp_path: Path) -> None:
    """The one would wait forever, the other fill the memory."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "huge").touch()
    os.truncate(tmp_path / "huge", 1 << 40)
    for name, reason in (("pipe", "is a pipe"), ("huge", "has more than 25000000 bytes")):
        with pytest.raises(FileKindError, match=reason):
            sha256(tmp_path / name)


def test_a_task_of_several_sides_has_no_entries(tmp_path: Path) -> None:
    """A file of ONNX would play the opponents too."""
    files = [tmp_path / f"theirs-{k}.onnx" for k in range(N_SEEDS)]
    with pytest.raises(SpecError, match="tag-medium is of tag, whose sides need opponents"):
        submit(files, tmp_path / "entry", "tag-medium", name="mine", **ABOUT)
