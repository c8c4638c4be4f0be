"""Verifies honest and forged entries in three settings, into docs/measurements.md.

    python -m tests.benchmarks.bench_leaderboard [FOLDER]

The entries are made of the package's trained policies. Entries and verdicts in FOLDER are kept, so
that a run that was interrupted goes on. Times are processor time, which the load of others changes
less than the clock.
"""

import json
import os
import resource
import sys
import time
from collections.abc import Callable
from functools import partial
from itertools import product
from pathlib import Path
from shutil import copytree, rmtree
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np
import onnx
from onnx import helper

from swarmdata import make_policy
from swarmdata.evaluation.leaderboard.entry import ENTRY, RESULTS, Description, sha256, submit
from swarmdata.evaluation.leaderboard.verify import N_EPISODES, Verdict, verify
from swarmdata.interop.exported_policies import export_policy
from swarmdata.numerics.random import block_seeds
from swarmdata.registry.components import make_env
from swarmdata.registry.recipes import find_recipe
from swarmdata.rollouts.rollout import rollout
from swarmdata.runtime.atomic import write_file
from swarmdata.specs.origins import task_of
from tests.benchmarks.measuring import table, write_section
from tests.support.onnx_files import with_last_nodes

FOLDER, ZOO = Path("build/leaderboard"), Path(__file__).parents[2] / "cards" / "zoo"

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


def entry_of(dataset: str, runs: list[Path], out: Path, name: str) -> None:
    """Submits runs."""
    submit(
        runs, out, dataset, name=name, license="Apache-2.0", code="https://example.org", trials=1,
        tuning_episodes=0, progress=False,
    )  # fmt: skip


def honest(run: str, out: Path) -> None:
    """The entry of a run of the package."""
    entry_of(run.partition("/")[0], [ZOO / run], out, run.replace("/", "-"))


def exported(run: str, out: Path, change: Callable[[Path], None] = lambda file: None) -> None:
    """The entry of the files of ONNX of a run of the package, changed or not."""
    files = [out.with_name(f"{out.name}-{seed}.onnx") for seed in range(N_SEEDS)]
    for seed, file in enumerate(files):
        file.unlink(missing_ok=True)
        export_policy(ZOO / run, file, seed)
        change(file)
    entry_of(run.partition("/")[0], files, out, run.replace("/", "-"))


def altered(out: Path, honest: Path) -> None:
    """The returns of an honest entry are a tenth of a unit higher."""
    copytree(honest, out)
    for file in (out / RESULTS).iterdir():
        document = json.loads(file.read_text())
        document["metrics"]["return"] = [value + 0.1 for value in document["metrics"]["return"]]
        file.write_text(json.dumps(document))


def other_data(out: Path, honest: Path) -> None:
    """An honest entry names the digest of another dataset."""
    copytree(honest, out)
    text = (out / ENTRY).read_text()
    (out / ENTRY).write_text(text.replace(Description.from_file(out / ENTRY).digest, "0" * 64))


def without_numbers(out: Path, honest: Path) -> None:
    """The policies of an honest entry of ONNX files answer NaN, under their old results."""
    copytree(honest, out)
    for file in out.glob("*.onnx"):
        before = sha256(file)
        with_last_nodes(file, helper.make_node("Sqrt", ["plain"], ["action"]))
        for text in (out / ENTRY, *(out / RESULTS).iterdir()):
            text.write_text(text.read_text().replace(before, sha256(file)))


def noisy(file: Path) -> None:
    """Adds a little noise to the actions of a file of ONNX."""
    noise = helper.make_node("RandomNormalLike", ["plain"], ["noise"], scale=0.02)
    with_last_nodes(file, noise, helper.make_node("Add", ["plain", "noise"], ["action"]))


def replayed(out: Path) -> None:
    """Files of ONNX that know the expert's actions in all reserved episodes, and play them.

    A robot recognizes its episode by its first observation: by the nearest of their products with
    random numbers. Its memory is the step, and the row of the table that it follows.
    """
    spec = task_of(find_recipe(REPLAYED), "a benchmark")
    env, seeds = make_env(spec, 64), block_seeds("evaluation", N_EPISODES)
    episodes = list(rollout(env, make_policy("expert", spec), seeds))
    starts = np.concatenate([each.observations[0] for each in episodes])  # [1000 N, O]
    actions = np.zeros((N_EPISODES, spec.n_agents, spec.horizon, spec.action_size), np.float32)
    for row, each in zip(actions, episodes, strict=True):
        row[:, : len(each.actions)] = each.actions.swapaxes(0, 1)
    files = [out.with_name(f"{out.name}-{seed}.onnx") for seed in range(N_SEEDS)]
    for seed, file in enumerate(files):
        weights = np.random.default_rng(seed).normal(size=(starts.shape[1], 1)).astype(np.float32)
        onnx.save(replay_network(weights, starts @ weights, actions), file)
    entry_of(REPLAYED, files, out, "replayed")


def replay_network(weights: Any, keys: Any, actions: Any) -> onnx.ModelProto:
    """The network of `replayed`: weights [O, 1], keys [rows, 1], actions [1000, N, T, A]."""
    horizon, size = actions.shape[2:]
    constants = {
        "weights": weights, "keys": keys.T, "table": actions.reshape(-1, size),
        "horizon": np.float32([[horizon]]), "last": np.float32([[horizon - 1]]),
        "one": np.float32([[1]]), "zero": np.float32([[0]]), "axis": np.int64([1]),
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
        ("Gather", ["table", "line"], ["action"], {"axis": 0}),
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
[Entries](evaluation.md#leaderboard-entries) made of the package's trained policies, some as ONNX \
files, and forged ones, verified with one thread, with two, and with code for an older processor \
(`python -m tests.benchmarks.bench_leaderboard`). {same} of {n} entries got the same verdict and \
the same means to the last bit in all three settings. Times are processor time; those with old \
code include compiling it once.

"""

RUNS = (
    "coop_nav-expert/bc", "coop_nav-expert/filtered_bc", "coop_nav-expert/maddpg_bc",
    "coop_nav-medium-expert/iql", "coop_nav-medium-replay/bc",
    "coop_nav-medium-replay/filtered_bc", "formation-medium-expert/iql",
    "intersection-strict-expert/bc", "pursuit-medium-replay/filtered_bc",
    "transport-expert/iql", "warehouse-medium-expert/iql", "search-strict-expert/bc",
)  # fmt: skip

EXPORTED = ("coop_nav-medium-replay/iql", "coop_nav-medium/iql", "pursuit-expert/bc")


def makers(folder: Path) -> dict[str, Callable[[Path], None]]:
    """What makes each entry, by its name; the honest ones first."""
    plain, onnx_files = (folder / each.replace("/", "-") for each in (RUNS[4], EXPORTED[0]))
    return {
        **{run: partial(honest, run) for run in RUNS},
        **{run: partial(exported, run) for run in EXPORTED},
        "altered returns": partial(altered, honest=plain),
        "replayed reserved episodes": replayed,
        "digest of other data": partial(other_data, honest=plain),
        "random actions": partial(exported, EXPORTED[0], change=noisy),
        "NaN": partial(without_numbers, honest=onnx_files),
    }


def measured(entry: Path, name: str) -> dict[str, Any]:
    """The verdict on an entry in a setting, and its processor time, s."""
    n_threads, environment = SETTINGS[name]
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    with patch.dict(os.environ, {"OMP_NUM_THREADS": str(n_threads), **environment}):
        verdict = verify(entry, seconds=LIMIT, n_threads=n_threads)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return {
        **verdict._asdict(),
        "seconds": after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
        "clock": time.perf_counter() - start,
    }


def all_measured(folder: Path) -> dict[str, dict[str, dict[str, Any]]]:
    """The verdicts on all entries by setting; what is missing in the folder is made."""
    file = folder / "verdicts.json"
    found = json.loads(file.read_text()) if file.exists() else {}
    makers_of = makers(folder)
    for setting, name in product(SETTINGS, makers_of):
        entry = folder / name.replace("/", "-").replace(" ", "-")
        if not entry.exists():
            part = entry.with_name(f"{entry.name}.part")
            rmtree(part, ignore_errors=True)
            makers_of[name](part)
            part.rename(entry)
        if setting not in found.setdefault(name, {}):
            found[name][setting] = measured(entry, setting)
            write_file(file, json.dumps(found, indent=1).encode())
            print(name, setting, found[name][setting], flush=True)
    return {name: found[name] for name in makers_of}


def text(found: dict[str, dict[str, dict[str, Any]]]) -> str:
    """The section: words, then a line for each entry."""
    rows, n_same = [], 0
    for name, by_setting in found.items():
        first, *others = (
            {key: each[key] for key in Verdict._fields} for each in by_setting.values()
        )
        is_same = all(str(each) == str(first) for each in others)
        n_same += is_same
        verdict = "; ".join(first["reasons"]) or "verified"
        means = (f"{first[key]:.3f}" for key in ("reserved", "fresh"))
        figures = (f"{100 * first['equal']:.1f}", *means)
        seconds = (f"{each['seconds']:.0f}" for each in by_setting.values())
        rows.append((name, verdict if is_same else f"not always: {verdict}", *figures, *seconds))
    head = (
        "entry", "verdict", "equal, %", "return, reserved", "return, fresh",
        *(f"{name}, s" for name in SETTINGS),
    )  # fmt: skip
    return INTRODUCTION.format(same=n_same, n=len(rows)) + table(head, rows)


def main(folder: Path) -> None:
    """Verifies all entries, and writes the section."""
    body = text(all_measured(folder))
    print(body)
    write_section("Leaderboard entries", body)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
