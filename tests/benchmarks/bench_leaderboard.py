"""Verifies honest and forged entries in three settings, into docs/measurements.md.

    python -m tests.benchmarks.bench_leaderboard [--episodes N] [--out FOLDER]

The entries are made of the package's trained policies. Entries and verdicts in FOLDER are kept, so
that a run that was interrupted goes on. Times are processor time, which the load of others changes
less than the clock.
"""

import argparse
import json
import os
import resource
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from shutil import copy, copytree, rmtree
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import onnx
from onnx import helper

from swarmdata import make_policy
from swarmdata.evaluation.leaderboard.entry import (
    ENTRY,
    N_EPISODES,
    RESULTS,
    Description,
    sha256,
    submit,
)
from swarmdata.evaluation.leaderboard.verify import Verdict, verify
from swarmdata.interop.exported_policies import export_policy
from swarmdata.numerics.random import block_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.recipes import find_recipe
from swarmdata.rollouts.rollout import rollout
from swarmdata.specs.origins import task_of
from swarmdata.store import write_file
from tests.benchmarks.measuring import table, write_section
from tests.support.onnx_files import with_last_nodes

ZOO = Path(__file__).parents[2] / "cards/zoo"

N_SEEDS = 5

LIMIT = 3600  # s of a verification; those of others slow it down

REPLAYED = "coop_nav-medium-replay"
"""The dataset of the forged entries."""


class Setting(NamedTuple):
    """What may not change a verdict."""

    n_threads: int
    environment: dict[str, str]


SETTINGS = {
    "1 thread": Setting(1, {}),
    "2 threads": Setting(2, {}),
    "older CPU": Setting(
        1,
        {
            "NUMBA_CPU_NAME": "x86-64-v2", "NUMBA_CPU_FEATURES": "",
            "ATEN_CPU_CAPABILITY": "default", "OPENBLAS_CORETYPE": "Nehalem",
        },
    ),
}  # fmt: skip


def entry_of(runs: list[Path], dataset: str, out: Path, n_episodes: int) -> None:
    """Submits runs."""
    submit(
        runs, out, dataset, name=out.stem, license="Apache-2.0", code="https://example.org",
        trials=1, tuning_episodes=0, n_episodes=n_episodes, progress=False,
    )  # fmt: skip


def honest(run: str, out: Path, n_episodes: int) -> None:
    """The entry of a run of the package."""
    entry_of([ZOO / run], run.partition("/")[0], out, n_episodes)


def exported(run: str, out: Path, n_episodes: int) -> None:
    """The entry of the files of ONNX of a run of the package."""
    files = [out.with_name(f"{out.stem}-{seed}.onnx") for seed in range(N_SEEDS)]
    for seed, file in enumerate(files):
        if not file.exists():
            export_policy(ZOO / run, file, seed)
    entry_of(files, run.partition("/")[0], out, n_episodes)


def altered(out: Path, n_episodes: int, honest: Path, metric: str, change: float) -> None:
    """A metric of an honest entry is changed in all episodes, not below 0 where it is not."""
    copytree(honest, out)
    for file in (out / RESULTS).iterdir():
        document = json.loads(file.read_text())
        values = document["metrics"][metric]
        document["metrics"][metric] = [max(each + change, min(values)) for each in values]
        file.write_text(json.dumps(document))


def other_data(out: Path, n_episodes: int, honest: Path) -> None:
    """An honest entry names the digest of another dataset."""
    copytree(honest, out)
    text = (out / ENTRY).read_text()
    (out / ENTRY).write_text(text.replace(Description.from_file(out / ENTRY).digest, "0" * 64))


def without_numbers(out: Path, n_episodes: int, honest: Path) -> None:
    """The policies of an honest entry of ONNX files answer NaN, under their old results."""
    copytree(honest, out)
    for file in out.glob("*.onnx"):
        before = sha256(file)
        with_last_nodes(file, helper.make_node("Sqrt", ["plain"], ["action"]))
        for text in (out / ENTRY, *(out / RESULTS).iterdir()):
            text.write_text(text.read_text().replace(before, sha256(file)))


def at_random(out: Path, n_episodes: int, honest: Path) -> None:
    """Those policies add a little noise to their actions; the results are their own."""
    noise = helper.make_node("RandomNormalLike", ["plain"], ["noise"], scale=0.02)
    files = []
    for seed, file in enumerate(sorted(honest.glob("*.onnx"))):
        files.append(Path(copy(file, out.with_name(f"{out.stem}-{seed}.onnx"))))
        with_last_nodes(files[-1], noise, helper.make_node("Add", ["plain", "noise"], ["action"]))
    entry_of(files, Description.from_file(honest / ENTRY).dataset, out, n_episodes)


def replayed(out: Path, n_episodes: int) -> None:
    """Files of ONNX that know the expert's actions in all reserved episodes, and play them.

    A robot recognizes its episode by its first observation: by the nearest of their products with
    random numbers. Its memory is the step, and the row of the table that it follows.
    """
    spec = task_of(find_recipe(REPLAYED), "a benchmark")
    env, seeds = make_env(spec, 64), block_seeds("evaluation", n_episodes)
    episodes = list(rollout(env, make_policy("expert", spec), seeds))
    starts = np.concatenate([each.observations[0] for each in episodes])  # [E N, O]
    actions = np.zeros((n_episodes, spec.n_agents, spec.horizon, spec.action_size), np.float32)
    for row, each in zip(actions, episodes, strict=True):
        row[:, : len(each.actions)] = each.actions.swapaxes(0, 1)
    files = [out.with_name(f"{out.stem}-{seed}.onnx") for seed in range(N_SEEDS)]
    for seed, file in enumerate(files):
        weights = np.random.default_rng(seed).normal(size=(starts.shape[1], 1)).astype(np.float32)
        onnx.save(replay_network(weights, starts @ weights, actions), file)
    entry_of(files, REPLAYED, out, n_episodes)


def replay_network(weights: Any, keys: Any, actions: Any) -> onnx.ModelProto:
    """The network of `replayed`: weights [O, 1], keys [rows, 1], actions [E, N, T, A]."""
    horizon, size = actions.shape[2:]
    one = np.ones((1, 1), np.float32)
    constants = {
        "weights": weights, "keys": keys.T, "table": actions.reshape(-1, size).astype(np.float16),
        "horizon": horizon * one, "last": (horizon - 1) * one, "one": one, "zero": 0 * one,
        "axis": np.array([1]),
    }  # fmt: skip
    nodes = [
        ("Split", ["memory"], ["time", "known"], {"axis": 1, "num_outputs": 2}),
        ("MatMul", ["observation", "weights"], ["key"], {}),
        ("Sub", ["key", "keys"], ["offset"], {}),
        ("Abs", ["offset"], ["distance"], {}),
        ("ArgMin", ["distance"], ["nearest"], {"axis": 1}),
        ("Cast", ["nearest"], ["found"], {"to": onnx.TensorProto.FLOAT}),
        ("Equal", ["time", "zero"], ["is_first"], {}),
        ("Where", ["is_first", "found", "known"], ["row"], {}),
        ("Mul", ["row", "horizon"], ["begin"], {}),
        ("Min", ["time", "last"], ["step"], {}),
        ("Add", ["begin", "step"], ["at"], {}),
        ("Cast", ["at"], ["index"], {"to": onnx.TensorProto.INT64}),
        ("Squeeze", ["index", "axis"], ["line"], {}),
        ("Gather", ["table", "line"], ["stored"], {"axis": 0}),
        ("Cast", ["stored"], ["action"], {"to": onnx.TensorProto.FLOAT}),
        ("Add", ["time", "one"], ["later"], {}),
        ("Concat", ["later", "row"], ["next_memory"], {"axis": 1}),
    ]
    sizes = {"observation": len(weights), "memory": 2, "action": size, "next_memory": 2}
    values = {
        name: helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["robots", n])
        for name, n in sizes.items()
    }
    graph = helper.make_graph(
        [helper.make_node(kind, a, b, **options) for kind, a, b, options in nodes],
        "replay",
        [values["observation"], values["memory"]],
        [values["action"], values["next_memory"]],
        [onnx.numpy_helper.from_array(value, name) for name, value in constants.items()],
    )
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)


INTRODUCTION = """\
[Entries](evaluation.md#leaderboard-entries) made of the package's trained policies, the last three
honest ones as files of ONNX, and forged ones, verified with one thread, with two, and with code for
an older processor (`python -m tests.benchmarks.bench_leaderboard --episodes {episodes}`): five
policies each, on as many reserved and as many fresh episodes. {same} of {n} entries got one verdict
in all three. Equal are the reserved episodes of which every metric is as claimed; a column says
whether all numbers were the same to the last bit. Times are processor time of the whole command;
with older code, they include compiling it.

"""

RUNS = (
    "coop_nav-expert/bc", "coop_nav-expert/filtered_bc", "coop_nav-expert/maddpg_bc",
    "coop_nav-medium-expert/iql", "coop_nav-medium-replay/bc",
    "coop_nav-medium-replay/filtered_bc", "formation-medium-expert/iql",
    "intersection-strict-expert/bc", "pursuit-medium-replay/filtered_bc",
    "transport-expert/iql", "warehouse-medium-expert/iql", "search-strict-expert/bc",
)  # fmt: skip

EXPORTED = ("coop_nav-expert/iql", "coop_nav-medium-replay/iql", "pursuit-expert/bc")


def makers(folder: Path) -> dict[str, Callable[[Path, int], None]]:
    """What makes each entry, by its name; the honest ones first."""
    plain, onnx_files = (
        folder / each.replace("/", "-") for each in ("coop_nav-expert/bc", EXPORTED[0])
    )
    return {
        **{run: partial(honest, run) for run in RUNS},
        **{run: partial(exported, run) for run in EXPORTED},
        "altered returns": partial(altered, honest=plain, metric="return", change=0.1),
        "altered collisions": partial(
            altered, honest=plain, metric="robot_collisions", change=-1.0
        ),
        "replayed reserved episodes": replayed,
        "digest of other data": partial(other_data, honest=plain),
        "random actions": partial(at_random, honest=onnx_files),
        "NaN": partial(without_numbers, honest=onnx_files),
    }


def measured(entry: Path, name: str, n_episodes: int) -> dict[str, Any]:
    """The verdict on an entry in a setting, and its processor time, s."""
    n_threads, environment = SETTINGS[name]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with patch.dict(os.environ, {"OMP_NUM_THREADS": str(n_threads), **environment}):
        verdict = verify(entry, n_episodes=n_episodes, seconds=LIMIT, n_threads=n_threads)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = (after.ru_utime - before.ru_utime) + (after.ru_stime - before.ru_stime)
    return {**verdict._replace(results=())._asdict(), "seconds": seconds}


def all_measured(folder: Path, n_episodes: int) -> dict[str, dict[str, dict[str, Any]]]:
    """The verdicts on all entries by setting; what is missing in the folder is made."""
    file, makers_of = folder / "verdicts.json", makers(folder)
    kept = json.loads(file.read_text()) if file.exists() else {}
    found: dict[str, dict[str, Any]] = {name: kept.get(name, {}) for name in makers_of}
    for setting, name in product(SETTINGS, makers_of):
        entry = folder / name.replace("/", "-").replace(" ", "-")
        if not entry.exists():
            part = entry.with_name(f"{entry.name}.part")
            rmtree(part, ignore_errors=True)
            makers_of[name](part, n_episodes)
            part.rename(entry)
        if setting not in found[name]:
            found[name][setting] = measured(entry, setting, n_episodes)
            write_file(file, json.dumps(found, indent=1).encode())
            print(name, setting, found[name][setting], flush=True)
    return found


def text(found: dict[str, dict[str, dict[str, Any]]], n_episodes: int) -> str:
    """The section: words, then a line for each entry."""
    rows, n_alike = [], 0
    for name, measurements in found.items():
        verdicts = [
            Verdict(**{key: each[key] for key in Verdict._fields}) for each in measurements.values()
        ]
        n_alike += len({each.is_verified for each in verdicts}) == 1
        first, is_same = verdicts[0], len(set(map(str, verdicts))) == 1
        rows.append(
            (
                name, "; ".join(first.reasons) or "verified", f"{100 * first.equal:.1f}",
                f"{first.reserved:.3f}", f"{first.fresh:.3f}", "yes" if is_same else "no",
                *(f"{each['seconds']:.0f}" for each in measurements.values()),
            )
        )  # fmt: skip
    head = (
        "entry", "verdict", "equal, %", "return, reserved", "return, fresh",
        "same numbers in all", *(f"{name}, s" for name in SETTINGS),
    )  # fmt: skip
    words = INTRODUCTION.format(same=n_alike, n=len(rows), episodes=n_episodes)
    return words + table(head, rows)


def main() -> None:
    """Verifies all entries, and writes the section."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--episodes", type=int, default=N_EPISODES, help="reserved episodes")
    parser.add_argument("--out", type=Path, default=Path("build/leaderboard"))
    arguments = parser.parse_args()
    folder = arguments.out / str(arguments.episodes)
    found = all_measured(folder, arguments.episodes)
    write_section("Leaderboard entries", text(found, arguments.episodes))


if __name__ == "__main__":
    main()
