"""The data files of a result: every measured episode of its runs, and replays of a few of them.

Episodes are played again where the measured run is at hand, and shown if they end as measured.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from swarmdata.catalogue.replays.data_files import pack, replay_table, write_script
from swarmdata.errors import SwarmdataError
from swarmdata.evaluation.results.policy_names import find_target
from swarmdata.evaluation.results.result_files import Result
from swarmdata.interfaces import Policy
from swarmdata.registry.components import make_env
from swarmdata.rollouts.rollout import rollout
from swarmdata.types import Double, Episode, Int

MAX_CODE = 30_000  # of a number of 16 bits

MAX_RETURN_ERROR = 1e-3
"""Between a measured return and that of its replay, which is only shown within it."""

COUNTS = ("robot_collisions", "obstacle_collisions")


class ReplayedEpisode(NamedTuple):
    """An episode that was played again."""

    run: int
    number: int  # among the episodes of its run
    episode: Episode


def run_names(results: Sequence[Result]) -> list[str]:
    """What the runs of a result are called: their training seeds, where they are known."""
    seeds = [result.provenance.seed for result in results]
    if len({*seeds}) == len(seeds) and None not in seeds:
        return [f"training seed {seed}" for seed in seeds]
    return [f"run {k}" for k in range(len(results))]


def play_again(results: Sequence[Result], note: Callable[[str], None]) -> list[ReplayedEpisode]:
    """Plays the episodes of lowest, median and highest return of each run that is at hand.

    `note` is told what cannot be played again, and why.
    """
    played = []
    for run, result in enumerate(results):
        policy = _policy_of(result, note)
        if policy is None or result.spec.world is None:
            continue
        returns = result.evaluation.metrics["return"]
        order = np.argsort(returns, kind="stable")
        chosen = np.unique(order[[0, len(order) // 2, -1]])
        episodes = rollout(make_env(result.spec.world), policy, result.evaluation.seeds[chosen])
        for number, episode in zip(chosen.tolist(), episodes, strict=True):
            if abs(episode.team_return - returns[number]) <= MAX_RETURN_ERROR:
                played.append(ReplayedEpisode(run, number, episode))
            else:
                note(
                    f"{result.run_folder}: episode {number} has return {episode.team_return:.3f} "
                    f"when it is played again, measured were {returns[number]:.3f}: no replay"
                )
    return played


def _policy_of(result: Result, note: Callable[[str], None]) -> Policy | None:
    """The policy that was measured; None if its run is not at hand, or was changed."""
    folder = result.run_folder
    if folder is None or not folder.is_dir():
        return None
    try:
        target = find_target(str(folder))
    except SwarmdataError as error:
        note(f"{folder}: no replays, {error}")
        return None
    for policy, provenance in zip(target.policies, target.provenances, strict=True):
        is_same = provenance.content == result.provenance.content
        if is_same and provenance.seed == result.provenance.seed and target.spec == result.spec:
            return policy
    note(f"{folder}: no replays, it was trained further or evaluated in another world")
    return None


def measured_columns(results: Sequence[Result]) -> list[str]:
    """Columns that the table of measured episodes has."""
    known = _defined(results)
    needs = {"end": {"success"}, "return": set(), "time": {"time_to_goal"}, "collisions": {*COUNTS}}
    return ["index", "policy", *(name for name, metrics in needs.items() if metrics <= known)]


def _defined(results: Sequence[Result]) -> set[str]:
    """Metrics with a value in all results; the time to goal has none if nothing is solved."""
    metrics = [result.evaluation.metrics for result in results]
    return {
        name
        for name in set.intersection(*map(set, metrics))
        if name == "time_to_goal" or all(np.isfinite(each[name]).all() for each in metrics)
    }


def write_measured(
    results: Sequence[Result], played: Sequence[ReplayedEpisode], folder: Path
) -> None:
    """Writes the data files of a result into a new folder, named as its key in the scripts.

    The results are of the same episodes, one for each training seed; replayed ones are the first
    rows.
    """
    folder.mkdir(parents=True)
    n = len(results[0].evaluation.seeds)
    first = [each.run * n + each.number for each in played]
    rows = np.array([*first, *(k for k in range(n * len(results)) if k not in {*first})])
    columns = _columns(results, rows // n, rows % n)
    packed = pack([codes[:, None] for _, codes in columns.values()], 0)
    write_script(folder, "measured.js", "measured", packed)
    table: dict[str, Any] = {
        "measured": [[name, unit] for name, (unit, _) in columns.items()],
        "replays": len(played),
        "n": len(rows),
        "lengths": [len(each.episode) for each in played],
        "episodes": {
            "policies": run_names(results), "ends": ["success", "unsolved"], "splits": []
        },
    }  # fmt: skip
    spec = results[0].spec.world
    if played and spec is not None:
        table |= replay_table([each.episode for each in played], spec, folder)
    write_script(folder, "episodes.js", "episodes", table)


def _columns(results: Sequence[Result], runs: Int, numbers: Int) -> dict[str, tuple[float, Int]]:
    """Name -> what a code means in the unit of the table, and the code of each row."""

    def values(name: str) -> Double:
        return np.stack([each.evaluation.metrics[name] for each in results])[runs, numbers]

    known = _defined(results)
    returns = values("return")
    columns = {"policy": (1.0, runs), "number": (1.0, numbers), "return": _fine(returns)}
    if "success" in known:
        columns["end"] = (1.0, (values("success") < 0.5).astype(np.int64))
    for name in COUNTS:
        counts = values(name) if name in known else np.zeros(len(runs))
        columns[name] = (1.0, np.rint(np.clip(counts, 0, MAX_CODE)).astype(np.int64))
    if "time_to_goal" in known:
        times = values("time_to_goal")
        unit, codes = _fine(np.where(np.isfinite(times), times, 0.0))
        columns["time"] = unit, np.where(np.isfinite(times), codes, -1)
    return columns


def _fine(values: Double) -> tuple[float, Int]:
    """Thousandths, or as fine as 16 bits allow."""
    unit = max(1e-3, float(np.abs(values).max(initial=0.0)) / MAX_CODE)
    return unit, np.rint(values / unit).astype(np.int64)
