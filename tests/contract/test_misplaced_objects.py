"""An object in the place of another is refused at the public entrances, with what to do instead."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch", reason="training and tensors need torch")

import swarmdata
from swarmdata.errors import SwarmdataError

untyped: Any = swarmdata  # mistakes that a type checker would find, too


class Unsure:
    """A policy without `log_probs`."""

    uses_state = False

    def reset(self, step: Any, copies: Any) -> None:
        pass

    def act(self, step: Any) -> Any:
        return np.zeros((len(step.seeds), 4, 2), np.float32)


SHORT: dict[str, Any] = {"n_episodes": 1, "progress": False}
NEW: dict[str, Any] = {"id": "coop_nav-new-v0", "progress": False}

MISTAKES: dict[str, tuple[Callable[[Any, Path], Any], str]] = {
    "train on a dataset": (
        lambda data, out: untyped.train("bc", data, out),
        r"dataset_id is <Dataset .*expected the id or folder .* swarmdata\.filter_dataset",
    ),
    "train on a subset": (
        lambda data, out: untyped.train("bc", data[:2], out),
        "dataset_id is <Dataset .*expected the id or folder",
    ),
    "train on a list of datasets": (
        lambda data, out: untyped.train("bc", [data, data], out),
        "dataset_id is <Dataset .*expected the id or folder",
    ),
    "train online in a dataset": (
        lambda data, out: untyped.train_online("mappo", data, out),
        r"the task is <Dataset .* Pass dataset\.task",
    ),
    "train online with a dataset": (
        lambda data, out: untyped.train_online("vdn", "coop_nav", out, data=data),
        "data is <Dataset .*expected the id or folder",
    ),
    "evaluate in a dataset": (
        lambda data, out: untyped.evaluate("scripted", data, **SHORT),
        r"the task is <Dataset .* Pass dataset\.task",
    ),
    "evaluate in no task": (
        lambda data, out: untyped.evaluate("scripted", None, **SHORT),
        "the task is None, expected a preset's name",
    ),
    "evaluate a function": (
        lambda data, out: untyped.evaluate(lambda seen: seen, "coop_nav", **SHORT),
        r"has no reset and no act .* Wrap a function in swarmdata\.FunctionPolicy",
    ),
    "evaluate a policy that is not whole": (
        lambda data, out: untyped.evaluate(Unsure(), "coop_nav", **SHORT),
        "has no log_probs, expected a policy",
    ),
    "evaluate a function on a side": (
        lambda data, out: untyped.evaluate(
            lambda seen: seen,
            "tag",
            side="evader",
            opponents="scripted",
            **SHORT,
        ),
        "has no reset and no act",
    ),
    **{
        f"evaluate on the seeds {seeds}": (
            partial(
                lambda data, out, seeds: untyped.evaluate(
                    "idle", "coop_nav", seeds=seeds, progress=False
                ),
                seeds=seeds,
            ),
            r"the seeds are .* expected a list of different whole numbers",
        )
        for seeds in ([1.5, 2], [-1], [True], [1 << 64], [3, 3])
    },
    "evaluate a part of an episode": (
        lambda data, out: untyped.evaluate("idle", "coop_nav", n_episodes=2.5),
        "n_episodes is 2.5, expected a whole number",
    ),
    "reset to a part of a seed": (
        lambda data, out: data.make_env(1).reset([0.5]),
        "the seeds are .* expected a list of whole numbers",
    ),
    "sample by a part of a seed": (
        lambda data, out: data.sampler(4, seed=1.5),
        "sampler seed is 1.5, expected a whole number",
    ),
    "sample by no seed": (
        lambda data, out: data.sampler(4, seed=None),
        "sampler seed is None, expected a whole number",
    ),
    "sample windows of a part of a step": (
        lambda data, out: data.sampler(4, horizon=1.5),
        "sampler horizon is 1.5, expected a whole number",
    ),
    "stream by a number": (
        lambda data, out: untyped.load(data.path, stream=1),
        "stream is 1, expected True or a Stream",
    ),
    "load with a function of rewards": (
        lambda data, out: untyped.load(data.path, rewards=lambda episode: 0),
        r"rewards is <function .* Dataset\.with_rewards takes functions",
    ),
    "weights of rewards in a mapping": (
        lambda data, out: data.with_rewards({"proximity": 2.0}),
        "with_rewards got {'proximity': 2.0}, expected a function of an episode, or weights as",
    ),
    "observe by a number": (
        lambda data, out: data.reobserve(3),
        "observation model is 3, expected a name",
    ),
    "an episode by a truth value": (
        lambda data, out: data[True],
        "a dataset got the index True",
    ),
    "a part of a copy": (
        lambda data, out: swarmdata.make_env("coop_nav", 2.5),  # type: ignore[call-overload]
        "n_copies is 2.5, expected a whole number",
    ),
    "noise in words": (
        lambda data, out: swarmdata.make_policy("scripted", "coop_nav", noise="low"),
        "action noise is 'low', expected a finite standard deviation",
    ),
    "choose a split by its number": (
        lambda data, out: data.split(0),
        "unknown split '0'",
    ),
    "filter an id": (
        lambda data, out: untyped.filter_dataset("coop_nav-medium-mini", out, id="coop_nav-x-v0"),
        r"the source is 'coop_nav.*expected a Dataset. swarmdata\.load",
    ),
    "filter by a mask of others": (
        lambda data, out: swarmdata.filter_dataset(data, out, id="coop_nav-x-v0", episodes=[True]),
        r"episodes are \[True\], expected numbers or a mask of 10 episodes",
    ),
    "filter by an episode that is not there": (
        lambda data, out: swarmdata.filter_dataset(data, out, id="coop_nav-x-v0", episodes=[10]),
        r"episodes of coop_nav-tiny-v0 \[10\] are not there",
    ),
    "combine one dataset": (
        lambda data, out: untyped.combine_datasets(data, out, id="coop_nav-x-v0"),
        "sources is <Dataset .*expected a list of datasets",
    ),
    "combine ids": (
        lambda data, out: untyped.combine_datasets(["a", "b"], out, id="coop_nav-x-v0"),
        "a source is 'a', expected a Dataset",
    ),
    "convert an id": (
        lambda data, out: untyped.export_dataset("coop_nav-medium-mini", out, format="d4rl"),
        "the dataset is 'coop_nav-medium-mini', expected a Dataset",
    ),
    "play a function in an environment": (
        lambda data, out: untyped.evaluate_parallel(
            lambda seen: seen,
            lambda: None,
            data.spec,
            np.arange(2, dtype=np.uint64),
        ),
        "has no reset and no act",
    ),
    "save what was measured": (
        lambda data, out: untyped.save_result(
            untyped.evaluate("idle", data.task, **SHORT),
            out,
        ),
        r"the result is EvalResult.* Pass swarmdata\.Result\(evaluation",
    ),
    "generate with negative noise": (
        lambda data, out: untyped.generate("coop_nav", "scripted", noise=-1, out=out, **NEW),
        "noise is -1, expected a standard deviation",
    ),
    "generate with a policy object": (
        lambda data, out: untyped.generate("coop_nav", Unsure(), out=out, **NEW),
        "policies is .*Unsure.*expected the name of a policy or a run folder",
    ),
    "load nothing": (
        lambda data, out: untyped.load(None),
        "dataset_id is None, expected the id or folder of a dataset",
    ),
    "load a dataset": (
        lambda data, out: untyped.load(data),
        r"dataset_id is <Dataset .* Pass its id or path",
    ),
    "open nothing": (
        lambda data, out: untyped.Dataset.open(None),
        "path is None, expected the folder of a dataset",
    ),
    "make a policy of nothing": (
        lambda data, out: untyped.make_policy(None, "coop_nav"),
        "the name is None, expected a registered policy",
    ),
    "find the frame of a dataset": (
        lambda data, out: untyped.frame_of(data),
        r"the spec is <Dataset .* Pass dataset\.spec",
    ),
    "turn a batch to a name": (
        lambda data, out: next(data.sampler(2)).in_frame("target"),
        r"frame is 'target', expected a Frame .*swarmdata\.frame_of",
    ),
    "tensors on a device that is not there": (
        lambda data, out: next(data.sampler(2)).to_torch("cuda:99"),
        "torch has no device 'cuda:99' here",
    ),
}


@pytest.fixture(scope="module")
def data(tiny: Path) -> swarmdata.Dataset:
    return swarmdata.Dataset.open(tiny)


@pytest.mark.parametrize("name", MISTAKES)
def test_what_is_no_such_thing_is_refused(
    name: str, data: swarmdata.Dataset, tmp_path: Path
) -> None:
    mistake, message = MISTAKES[name]
    with pytest.raises(SwarmdataError, match=message):
        mistake(data, tmp_path / "out")
    assert not (tmp_path / "out").exists()
