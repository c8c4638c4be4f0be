"""Where a memory matters: policies of the present, of four frames and with a gated unit.

    python -m tests.benchmarks.bench_memory --out runs/bench_memory

Each algorithm learns from the same recorded steps in each view: the data as they are recorded, or
as robots with other sensors and radios would have seen them. It acts on the present observation, on
the last four of them (`stack-4`), or with `memory=gru`. All are played on the same validation
episodes, in the view that they learned in. The tables go into docs/measurements.md.

Every finished policy is kept in the folder `--out` and is not trained again; delete its file there
to measure it again. All of it takes hours; the tables have what is finished.
"""

import argparse
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import torch

from swarmdata import evaluate, load
from swarmdata.building.edit import subsample_dataset
from swarmdata.datasets.dataset import Dataset
from swarmdata.evaluation.results.result_set import reference_of
from swarmdata.learn.training.overrides import override
from swarmdata.learn.training.trainer import Schedule, train_seeds
from swarmdata.registry.components import OFFLINE_ALGORITHMS, resolve
from swarmdata.registry.published import normalized_score
from swarmdata.rollouts.score_intervals import difference_interval, mean_interval, target_of
from swarmdata.rollouts.score_statistics import Estimate
from swarmdata.rollouts.task_frame import frame_of
from swarmdata.types import Double
from tests.benchmarks.bench_algorithms import Kept, Played
from tests.benchmarks.measuring import table, write_section
from tests.benchmarks.peers.team_data import Budget

ALGORITHMS = ("bc", "filtered_bc", "iql", "vdn", "mac_flow")
"""With the settings of their defaults: `vdn` with the regularizer `bc`."""

NETWORKS = ("hidden", "actor_hidden", "critic_hidden", "flow_hidden")
"""Settings of the sizes of networks."""


class View(NamedTuple):
    """Data, and what robots sense and hear in them."""

    dataset: str
    observation: str
    communication: str
    four_steps: str | None = None  # the communication whose messages count for three steps more
    burn_in: int = 10  # steps that a gated unit sees before a segment


VIEWS = {
    "scripted": View("coop_nav-scripted", "state", "none"),
    "lidar-16": View("coop_nav-expert", "lidar-16", "none"),
    "bearing": View("coop_nav-expert", "bearing", "none"),
    "goal-for-10": View("coop_nav-expert", "state+goal-for-10", "none", burn_in=60),
    "errand-lossy-60": View(
        "coop_nav-expert", "state+goal-for-0", "errand+lossy-60+expires-0",
        four_steps="errand+lossy-60+expires-3",
    ),
    "told-perfect": View(
        "coop_nav-expert", "state+goal-for-0+no-velocities", "errand+expires-0",
        four_steps="errand+expires-3",
    ),
    "told-lossy-60": View(
        "coop_nav-expert", "state+goal-for-0+no-velocities", "errand+lossy-60+expires-0",
        four_steps="errand+lossy-60+expires-3",
    ),
}  # fmt: skip
"""By the name of their column. The first is as recorded; the others are of experts that observed
everything, so that what is missing is what robots of the view cannot know. A goal that is shown in
the first 10 steps is known in a segment only if the burn-in reaches back to them."""

PRESENT, STACK, GRU = MEMORIES = ("present", "stack-4", "gru")
"""What a policy acts on: the present, which the others are compared with; the last four steps; all
of the episode. `stack-4` stacks what robots sense, and messages are kept as long."""


class Row(NamedTuple):
    """An algorithm, and what its policies act on."""

    algorithm: str
    memory: str  # of `MEMORIES`

    @property
    def file_name(self) -> str:
        """Of what is kept."""
        return f"{self.algorithm}-{self.memory}"


def config_of(row: Row, view: View, budget: Budget) -> object:
    """The defaults at a budget, with the memory that the view needs."""
    config = resolve("algorithm", OFFLINE_ALGORITHMS, row.algorithm).Config()
    units = f"{budget.units},{budget.units}"
    changes = {"n_updates": str(budget.n_updates), "batch_size": str(budget.batch_size)}
    changes |= {name: units for name in NETWORKS if hasattr(config, name)}
    if row.memory == GRU:
        changes |= {"memory": "gru", "burn_in": str(view.burn_in)}
    return override(config, changes)


def models_of(view: View, memory: str) -> tuple[str, str]:
    """The models of sensors and radio with which policies of a memory observe a view."""
    if memory != STACK:
        return view.observation, view.communication
    return f"{view.observation}+{STACK}", view.four_steps or view.communication


def smaller(dataset_id: str, n_steps: int, folder: Path) -> Dataset:
    """Some episodes of a dataset, with at least `n_steps` joint steps; all if it has no more."""
    whole = load(dataset_id, progress=False)
    if whole.n_steps <= n_steps:
        return whole
    name = f"{whole.task.task}-{n_steps}-steps-v1"
    out = folder / f"{whole.id}-{n_steps}"
    return subsample_dataset(whole, out, id=name, n_steps=n_steps)


def train_row(row: Row, view: View, data: Dataset, budget: Budget, kept: Kept) -> None:
    """Trains and plays all seeds of a row, unless they are kept.

    Args:
        row: what to train.
        view: what it is trained in.
        data: as robots with this memory observe them.
        budget: how much.
        kept: of the view.
    """
    name = row.file_name
    if all(kept.has(name, seed, budget) for seed in range(budget.n_seeds)):
        return
    world = data.task
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        policies = train_seeds(
            row.algorithm,
            data.split("train"),
            folder,
            seeds=range(budget.n_seeds),
            config=config_of(row, view, budget),
            schedule=Schedule(
                checkpoint_every=budget.n_updates, log_every=min(100, budget.n_updates)
            ),
            frame=frame_of(world),
            progress=False,
        )
    seconds = (time.process_time() - begin) / budget.n_seeds
    for seed, policy in enumerate(policies):
        metrics = evaluate(
            policy, world, name=name, n_episodes=budget.n_episodes, block="validation",
            progress=False,
        ).metrics  # fmt: skip
        kept.write(name, seed, metrics, seconds)
        print(f"{kept.folder.name}, {name}, {seed}: {metrics['return'].mean():.2f}", flush=True)


def train_view(view: View, rows: Sequence[Row], n_steps: int, budget: Budget, kept: Kept) -> None:
    """Trains and plays the rows of a view that are not kept yet."""
    recorded = smaller(view.dataset, n_steps, kept.folder.parents[1] / "data")
    for memory in MEMORIES:
        missing = [row for row in rows if row.memory == memory]
        if all(kept.read(row.file_name, budget) is not None for row in missing):
            continue
        data = recorded.reobserve(*models_of(view, memory), progress=False)
        for row in missing:
            train_row(row, view, data, budget, kept)


Found = Mapping[str, Mapping[Row, Played]]
"""What is kept of each view."""


def scores_of(view: View, played: Played) -> Double:
    """Scores of all seeds on all episodes, [K, E]; 100 is the expert that observes everything.

    Raises:
        ValueError: no references were measured in the task.
    """
    reference = reference_of(load(view.dataset, progress=False).spec)
    if reference is None:
        raise ValueError(f"{view.dataset}: no references were measured in its task")
    return normalized_score(played.metrics["return"], reference)


def score_rows(found: Found) -> list[tuple[str, ...]]:
    """Scores by row and view; of a memory, with the difference to the present alone."""
    scores = {
        name: {row: scores_of(VIEWS[name], played) for row, played in each.items()}
        for name, each in found.items()
    }

    def cell(row: Row, view: Mapping[Row, Double]) -> str:
        if row not in view:
            return ""
        present = Row(row.algorithm, PRESENT)
        if row == present or present not in view:
            return shown(mean_interval(view[row]))
        return gain(view[row], view[present])

    return [(*label(row), *(cell(row, view) for view in scores.values())) for row in rows_of(found)]


def success_rows(found: Found) -> list[tuple[str, ...]]:
    """Success and clean success by row and view, in percent."""

    def cell(played: Played | None) -> str:
        if played is None:
            return ""
        return " / ".join(
            f"{100 * played.metrics[name].mean():.0f}" for name in ("success", "clean_success")
        )

    return [
        (*label(row), *(cell(view.get(row)) for view in found.values()), seconds(row, found))
        for row in rows_of(found)
    ]


def rows_of(found: Found) -> list[Row]:
    """The rows of which something is kept, in order."""
    rows = [Row(algorithm, memory) for algorithm in ALGORITHMS for memory in MEMORIES]
    return [row for row in rows if any(row in view for view in found.values())]


def label(row: Row) -> tuple[str, str]:
    """The first two cells of a row."""
    return f"`{row.algorithm}`", row.memory if row.memory == PRESENT else f"`{row.memory}`"


def shown(score: Estimate) -> str:
    """A score with its interval."""
    return f"{score.value:.1f} ({score.low:.1f} to {score.high:.1f})"


def gain(scores: Double, present: Double) -> str:
    """A score, and what it is above that of the present; bold if the interval leaves out 0."""
    difference = difference_interval(scores, present)
    text = f"{difference.value:+.1f} ({difference.low:+.1f} to {difference.high:+.1f})"
    is_clear = difference.low > 0 or difference.high < 0
    return f"{scores.mean():.1f}: {f'**{text}**' if is_clear else text}"


def seconds(row: Row, found: Found) -> str:
    """Smallest and largest processor time of a seed."""
    times = [view[row].seconds for view in found.values() if row in view]
    low, high = f"{min(times):.0f}", f"{max(times):.0f}"
    return low if low == high else f"{low}–{high}"


def described(name: str) -> str:
    """Says what robots of a view sense and hear."""
    view = VIEWS[name]
    parts = [f"`{name}`: `{view.dataset}` seen with `{view.observation}`"]
    if view.communication != "none":
        parts.append(f", heard with `{view.communication}`")
    if view.four_steps is not None:
        parts.append(f" (beside `{STACK}`: `{view.four_steps}`)")
    if view.burn_in != View._field_defaults["burn_in"]:
        parts.append(f", `burn_in={view.burn_in}`")
    return "".join(parts)


def text(budget: Budget, n_steps: int, found: Found) -> str:
    """The section of docs/measurements.md."""
    views = "; ".join(described(name) for name in found)
    intro = (
        "Policies of the present observation, of the last four (`stack-4`), and with a gated unit "
        f"(`memory=gru`), in views of data. {views}. {budget.n_updates:,} updates of "
        f"{budget.batch_size} joint transitions from {n_steps:,} recorded steps, hidden layers of "
        f"{budget.units} units, {budget.n_seeds} seeds, {budget.n_episodes} validation episodes; "
        "everything else as in the defaults. A score of 100 is the expert that observes "
        "everything. Of a memory, the difference to the present alone follows, paired by episode, "
        f"bold if its interval leaves out 0. Intervals (95 %) are for {target_of([budget.n_seeds])}"
        " (`python -m tests.benchmarks.bench_memory`)."
    )
    head = ("algorithm", "acts on", *(f"`{name}`" for name in found))
    scores = table(head, score_rows(found)).rstrip()
    successes = table((*head, "CPU s a seed"), success_rows(found)).rstrip()
    return f"{intro}\n\nScores:\n\n{scores}\n\nSuccess / clean success, %:\n\n{successes}"


def parsed(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The arguments of the command line."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--views", nargs="+", default=tuple(VIEWS), choices=tuple(VIEWS))
    parser.add_argument("--algorithms", nargs="+", default=ALGORITHMS, choices=ALGORITHMS)
    parser.add_argument("--memories", nargs="+", default=MEMORIES, choices=MEMORIES)
    parser.add_argument("--steps", type=int, default=200_000, help="recorded joint steps")
    parser.add_argument("--updates", type=int, default=3_000)
    parser.add_argument("--batch", type=int, default=Budget.batch_size)
    parser.add_argument("--units", type=int, default=Budget.units)
    parser.add_argument("--seeds", type=int, default=Budget.n_seeds)
    parser.add_argument("--episodes", type=int, default=Budget.n_episodes)
    parser.add_argument("--out", type=Path, default=Path("runs/bench_memory"))
    parser.add_argument("--only-kept", action="store_true", help="train nothing: finished seeds")
    parser.add_argument(
        "--only-print", action="store_true", help="leave docs/measurements.md alone"
    )
    return parser.parse_args(arguments)


def read(folder: Path, budget: Budget) -> Found:
    """What is kept of all views with all seeds."""
    found: dict[str, dict[Row, Played]] = {}
    for name in VIEWS:
        for row in (Row(algorithm, memory) for algorithm in ALGORITHMS for memory in MEMORIES):
            played = Kept(folder / name).read(row.file_name, budget)
            if played is not None:
                found.setdefault(name, {})[row] = played
    return found


def main(arguments: Sequence[str] | None = None) -> None:
    """Measures what is asked for and not kept yet, and writes the section of all that is kept."""
    given = parsed(arguments)
    torch.set_num_threads(1)
    budget = Budget(given.updates, given.batch, given.units, given.seeds, given.episodes)
    size = f"{given.steps}-{budget.n_updates}x{budget.batch_size}x{budget.units}"
    folder = given.out / size
    for algorithm in () if given.only_kept else given.algorithms:
        rows = [Row(algorithm, memory) for memory in MEMORIES if memory in given.memories]
        for name in given.views:
            train_view(VIEWS[name], rows, given.steps, budget, Kept(folder / name))
    body = text(budget, given.steps, read(folder, budget))
    print(body)
    if not given.only_print:
        write_section("Memory", body)


if __name__ == "__main__":
    main()
