"""Reobservation: the `Observer` of live worlds over recorded states, with other models."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from swarmdata.errors import SpecError
from swarmdata.interfaces import Task
from swarmdata.perception.observer import Observer
from swarmdata.registry.components import make_task
from swarmdata.runtime.mapped_pages import MappedReads, release_pages
from swarmdata.specs.model_choice import check_messages, describe
from swarmdata.specs.origins import task_of
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset
from swarmdata.store.arrays.running_moments import train_moments
from swarmdata.store.arrays.scratch_arrays import new_arrays
from swarmdata.types import Bool, Double, Episode, Float, Int, Seeds, blank_step, shortened

N_OBSERVED_COPIES = 256
"""Episodes observed together: enough to make a call cheap, few enough to stay in the cache."""

OBSERVED_STATES = 100_000  # most states of episodes that are observed together, unless one has more
COPIED_ROWS = 100_000  # rows of actions that are copied together

OBSERVED_ARRAYS = ("observations", "sent", "delivered", "ages")
"""Arrays that a reobservation computes, in the order of `Observer.allocate`."""


@dataclass(frozen=True, slots=True, eq=False)
class RecordedEpisodes:
    """Episodes to observe again, joined: R rows of states, one per episode fewer of actions."""

    states: Float  # [R, S]
    actions: Float  # [R - n, N, A]
    starts: Int  # [n] first row of each episode's actions; of its states: start + index
    lengths: Int  # [n] joint steps, T
    seeds: Seeds  # [n]
    layouts: Float  # [n, M, 8]


@dataclass(frozen=True, eq=False, repr=False)
class Reobservation:
    """The episodes of a dataset, observed through other models."""

    recorded: StoredDataset  # the dataset as it was recorded
    spec: TaskSpec  # the task with the new models
    arrays: Mapping[str, NDArray[Any]]
    """The recorded ones, with those of `OBSERVED_ARRAYS` computed anew."""

    def __repr__(self) -> str:
        return shortened(f"<Reobservation of {self.recorded!r}: {self.summary}>")

    @property
    def summary(self) -> str:
        """The new models and those that the policies acted on, a few words."""
        return f"seen with {describe(self.spec)}; acted on {describe(self.recorded_task)}"

    @property
    def recorded_task(self) -> TaskSpec:
        return task_of(self.recorded.recipe, "a reobservation")

    @property
    def note(self) -> str:
        """One paragraph about what the acting policies observed, Markdown."""
        return (
            "> **This is a reobservation.** Observations and messages were computed from the "
            f"recorded states, with {describe(self.spec)}. The policies that chose the actions had "
            f"other inputs: {describe(self.recorded_task)}. The card below describes the recorded "
            "dataset.\n"
        )

    @cached_property
    def moments(self) -> tuple[Double, Double]:
        """Mean and standard deviation of observations over the train split, [O] each."""
        return train_moments(replace(self.recorded, arrays=dict(self.arrays)), "observations")


def reobserve(recorded: StoredDataset, spec: TaskSpec, *, progress: bool = True) -> Reobservation:
    """Observes every episode of a stored dataset through the models of `spec`.

    The result is in `new_arrays`. Nothing else is copied, except the commands, where recorded
    actions hold learned messages and the new models have none.

    Raises:
        SpecError: the new models need learned messages that the recorded actions do not hold, or
            the episodes lack their obstacles.
        DiskFullError: the result is large, and no space is left.
    """
    task, world = task_of(recorded.recipe, "reobservation"), make_task(spec)
    if (found := recorded.table.layouts.shape[1]) != len(world.kinds):
        raise SpecError(
            f"{recorded.manifest.id} has {found} obstacles in each episode, expected "
            f"{len(world.kinds)}: the format that it was imported from does not keep them. Observe "
            "the original dataset again, or convert it by way of minari or d4rl"
        )
    actions = actions_for(spec, task, recorded.arrays["actions"])
    table, arrays = recorded.table, recorded.arrays
    episodes = RecordedEpisodes(
        arrays["states"], actions, table.starts, table.lengths, table.seeds, table.layouts
    )
    observed = observe_episodes(world, episodes, progress=progress)
    arrays = {**recorded.arrays, **observed, "actions": actions}
    return Reobservation(recorded, spec, arrays)


def reobserve_episode(episode: Episode, task: Task) -> dict[str, NDArray[Any]]:
    """Observes one episode through the models of `task.spec`; returns `OBSERVED_ARRAYS`."""
    recorded = RecordedEpisodes(
        episode.states,
        episode.actions,
        starts=np.zeros(1, dtype=np.int64),
        lengths=np.array([len(episode)], dtype=np.int64),
        seeds=np.array([episode.seed], dtype=np.uint64),
        layouts=episode.layout[None],
    )
    return observe_episodes(task, recorded, progress=False)


def reobserved_episode(episode: Episode, recorded: TaskSpec, spec: TaskSpec) -> Episode:
    """An episode that was recorded in one spec, through the models of another of the same world.

    Raises:
        SpecError: the new models need learned messages that the actions do not hold.
    """
    actions = actions_for(spec, recorded, episode.actions)
    cut = replace(episode, actions=actions)
    observed: dict[str, Any] = reobserve_episode(cut, make_task(spec))
    return replace(cut, **observed)


def actions_for(spec: TaskSpec, recorded: TaskSpec, actions: Float) -> Float:
    """The part of the recorded actions [R, N, A] that belongs to the models of `spec`.

    Raises:
        SpecError: the new models need learned messages that were not recorded, or of another size.
    """
    check_messages(spec, recorded)
    if spec.action_size == recorded.action_size:
        return actions
    shape = (*actions.shape[:-1], spec.action_size)
    commands = new_arrays({"actions": (shape, actions.dtype)})["actions"]
    for first in range(0, len(actions), COPIED_ROWS):
        rows = slice(first, first + COPIED_ROWS)
        commands[rows] = actions[rows, ..., : spec.action_size]
        release_pages(actions[rows])
        release_pages(commands[rows])
    commands.setflags(write=False)
    return commands


def observe_episodes(
    task: Task,
    episodes: RecordedEpisodes,
    *,
    n_copies: int = N_OBSERVED_COPIES,
    progress: bool = True,
) -> dict[str, NDArray[Any]]:
    """Runs the observer of a task over recorded episodes; returns `OBSERVED_ARRAYS`, read-only.

    Episodes of similar length run side by side, at most `n_copies`, which the result does not show.
    """
    n_copies = max(1, min(n_copies, len(episodes.lengths)))
    reobserver, total = _Reobserver(task, episodes, n_copies), len(episodes.states)
    kinds = {n: ((total, *each.shape[1:]), each.dtype) for n, each in reobserver.fields.items()}
    results = new_arrays(kinds)
    read, written = MappedReads((episodes.states, episodes.actions)), MappedReads(results.values())
    hidden = None if progress else True  # None: hidden where there is no terminal
    with tqdm(total=total, desc="observing", unit="state", unit_scale=True, disable=hidden) as bar:
        for group in _groups(episodes.lengths, n_copies):
            joined = _joined(episodes, group, read)
            observed = reobserver.observe(joined)
            starts = episodes.starts[group] + group
            _spread(observed, joined, results, starts, written)
            bar.update(len(joined.states))
    for array in results.values():
        array.setflags(write=False)
    return results


def _groups(lengths: Int, n_copies: int) -> Iterator[Int]:
    """Yields episodes to observe together, longest first: at most `n_copies`, and few states."""
    order = np.argsort(-lengths, kind="stable")
    first = 0
    while first < len(order):
        longest = int(lengths[order[first]]) + 1
        last = first + max(1, min(n_copies, OBSERVED_STATES // longest))
        yield order[first:last]
        first = last


def _joined(episodes: RecordedEpisodes, group: Int, reads: MappedReads) -> RecordedEpisodes:
    """Copies some episodes, in their order, into arrays of their own."""
    starts, lengths = episodes.starts[group], episodes.lengths[group]
    states, actions = [], []
    for index, start, length in zip(group.tolist(), starts.tolist(), lengths.tolist(), strict=True):
        rows = episodes.states[start + index : start + index + length + 1]
        taken = episodes.actions[start : start + length]
        states.append(rows.copy())
        actions.append(taken.copy())
        reads.add(rows, taken)
    return RecordedEpisodes(
        np.concatenate(states),
        np.concatenate(actions),
        starts=np.cumsum(lengths) - lengths,
        lengths=lengths,
        seeds=episodes.seeds[group],
        layouts=episodes.layouts[group],
    )


def _spread(
    observed: Mapping[str, NDArray[Any]],
    joined: RecordedEpisodes,
    results: Mapping[str, NDArray[Any]],
    starts: Int,
    writes: MappedReads,
) -> None:
    """Copies what was observed in joined episodes to the rows of the results that begin there."""
    sources = joined.starts + np.arange(len(starts))
    for name, values in observed.items():
        if not values.size:
            continue
        for source, start, length in zip(
            sources.tolist(), starts.tolist(), joined.lengths.tolist(), strict=True
        ):
            rows = results[name][start : start + length + 1]
            rows[:] = values[source : source + length + 1]
            writes.add(rows)


class _Reobserver:
    """Feeds recorded rows to an observer of E copies, one step of all of them after the other."""

    def __init__(self, task: Task, episodes: RecordedEpisodes, n_copies: int) -> None:
        self._observer = observer = Observer(task, n_copies)
        self._actions = np.zeros((n_copies, *episodes.actions.shape[1:]), dtype=np.float32)
        self._active: Bool = np.zeros(n_copies, dtype=np.bool_)
        # what is observed of one state, by name, [E, ...]
        self.fields: dict[str, Any] = dict(
            zip(OBSERVED_ARRAYS, observer.allocate((n_copies,), task.spec.n_agents), strict=True)
        )
        self._step = blank_step(
            states=np.zeros((n_copies, episodes.states.shape[1]), dtype=np.float32),
            layouts=np.zeros((n_copies, *episodes.layouts.shape[1:]), dtype=np.float32),
            **self.fields,
        )

    def observe(self, recorded: RecordedEpisodes) -> dict[str, NDArray[Any]]:
        """Observes at most E episodes, longest first: `OBSERVED_ARRAYS`, a row for each state."""
        # not zeroed: every row is written
        results: dict[str, NDArray[Any]] = {
            name: np.empty((len(recorded.states), *field.shape[1:]), dtype=field.dtype)
            for name, field in self.fields.items()
        }
        step, starts, lengths = self._step, recorded.starts, recorded.lengths
        n = len(lengths)
        first_states = starts + np.arange(n)
        step.seeds[:n], step.layouts[:n] = recorded.seeds, recorded.layouts
        self._active[:n], self._active[n:] = True, False
        self._load_states(recorded, first_states, 0)
        self._observer.observe(step, None, self._active, np.arange(n))
        self._store(results, first_states)
        for t in range(1, int(lengths[0]) + 1):
            n = int(np.searchsorted(-lengths, -t, side="right"))  # those with a state t
            self._active[n:] = False
            rows = starts[:n] + (t - 1)
            np.take(recorded.actions, rows, axis=0, out=self._actions[:n], mode="clip")
            rows = first_states[:n] + t
            self._load_states(recorded, rows, t)
            self._observer.observe(step, self._actions, self._active)
            self._store(results, rows)
        return results

    def _load_states(self, recorded: RecordedEpisodes, rows: Int, t: int) -> None:
        n = len(rows)
        np.take(recorded.states, rows, axis=0, out=self._step.states[:n], mode="clip")
        self._step.times[:n] = t

    def _store(self, results: Mapping[str, NDArray[Any]], rows: Int) -> None:
        for name, source in self.fields.items():
            if source.size:  # robots without a channel have arrays without elements
                results[name][rows] = source[: len(rows)]


def attempted_links(episode: Episode, spec: TaskSpec) -> Bool | None:
    """Links over which messages would have arrived without losses on air, [T + 1, N, N].

    None where robots have no radio.
    """
    model = spec.communication
    if not isinstance(model, Broadcast):
        return None
    no_losses = {"drop_probability": 0.0, "bursts": None, "slots_in_step": None}
    drawn = spec.randomization.model_copy(update={"drop_probability": None})
    ideal = spec.with_updates(communication=model.model_copy(update=no_losses), randomization=drawn)
    return reobserve_episode(episode, make_task(ideal))["delivered"]
