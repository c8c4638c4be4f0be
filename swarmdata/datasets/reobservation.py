"""What robots would have seen and heard through other models, from recorded states.

The same `Observer` that a live world runs is run over the stored states, layouts, seeds and
actions, so the recorded models give the recorded arrays bit for bit.
"""

from collections.abc import Mapping
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
from swarmdata.specs.model_choice import describe, models_json
from swarmdata.specs.origins import task_of
from swarmdata.specs.sensing_models import Broadcast
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset
from swarmdata.store.arrays.running_moments import Moments
from swarmdata.types import Bool, Double, Episode, Float, Int, Seeds, Step

N_COPIES = 256
"""Episodes observed together: enough to make a call cheap, few enough to stay in the cache."""

OBSERVED = ("observations", "sent", "delivered", "ages")
"""Arrays that re-observation writes, in the order of `Observer.allocate`."""


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """The recorded episodes that are observed again; R rows of states, one more per episode."""

    states: Float  # [R, S]
    actions: Float  # [R - n, N, A]
    starts: Int  # [n] first row of each episode's actions; of its states: start + index
    lengths: Int  # [n] joint steps, T
    seeds: Seeds  # [n]
    layouts: Float  # [n, M, 8]


@dataclass(frozen=True, eq=False)
class View:
    """A dataset seen through other models.

    Attributes:
        recorded: the dataset as it was recorded.
        spec: the task with the models of the view.
    """

    recorded: StoredDataset
    spec: TaskSpec
    arrays: Mapping[str, NDArray[Any]]

    @property
    def recorded_task(self) -> TaskSpec:
        """The task as it was recorded."""
        return task_of(self.recorded.recipe, "a view")

    @property
    def identity(self) -> str:
        """Canonical JSON of the two models; with the dataset's digest it says what was seen."""
        return models_json(self.spec)

    @property
    def note(self) -> str:
        """One paragraph that says what the acting policies saw, Markdown."""
        return (
            f"> **This is a view.** It shows {describe(self.spec)}, computed from the recorded "
            "states. The actions came from policies that saw something else: "
            f"{describe(self.recorded_task)}. What follows describes the recorded dataset.\n"
        )

    @cached_property
    def moments(self) -> tuple[Double, Double]:
        """Mean and standard deviation of observations over the train split, [O] each."""
        table, moments = self.recorded.table, Moments()
        observations = self.arrays["observations"]
        for index in np.flatnonzero(table.split == 0):
            first = int(table.starts[index]) + int(index)
            rows = observations[first : first + int(table.lengths[index]) + 1]
            moments.add(rows.reshape(-1, rows.shape[-1]))
        mean, std = moments.result()
        return np.array(mean), np.array(std)


def reobserve(recorded: StoredDataset, spec: TaskSpec, *, progress: bool = True) -> View:
    """Observes every episode of a stored dataset through the models of `spec`.

    The result holds 4 N (O + P) + 2 N^2 bytes per state in memory (N^2 and P with a channel only),
    1.1 GB for a million states of four robots with 16 lidar rays; nothing else is copied. Where the
    recorded actions hold learned messages and the view has none, the commands are copied as well.

    Args:
        recorded: the open files.
        spec: the recorded task with other models.
        progress: whether to show a bar (on standard error, if that is a terminal).

    Raises:
        SpecError: the view asks for learned messages that the recorded actions do not hold.
    """
    task = task_of(recorded.recipe, "re-observation")
    actions = actions_for(spec, task, recorded.arrays["actions"])
    table, arrays = recorded.table, recorded.arrays
    tracks = Tracks(
        arrays["states"], actions, table.starts, table.lengths, table.seeds, table.layouts
    )
    observed = observe_tracks(make_task(spec), tracks, progress=progress)
    arrays = {**recorded.arrays, **observed, "actions": actions}
    return View(recorded, spec, arrays)


def reobserve_episode(episode: Episode, task: Task) -> dict[str, NDArray[Any]]:
    """Observes one episode through the models of `task.spec`; arrays `OBSERVED`, T + 1 rows."""
    tracks = Tracks(
        episode.states,
        episode.actions,
        starts=np.zeros(1, dtype=np.int64),
        lengths=np.array([len(episode)], dtype=np.int64),
        seeds=np.array([episode.seed], dtype=np.uint64),
        layouts=episode.layout[None],
    )
    return observe_tracks(task, tracks, progress=False)


def seen_again(episode: Episode, recorded: TaskSpec, spec: TaskSpec) -> Episode:
    """The same episode through the models of `spec`.

    Args:
        episode: as it was recorded.
        recorded: the spec that made it.
        spec: the same world with other models.

    Raises:
        SpecError: learned messages are wanted that the actions do not hold.
    """
    actions = actions_for(spec, recorded, episode.actions)
    chosen = replace(episode, actions=actions)
    observed: dict[str, Any] = reobserve_episode(chosen, make_task(spec))
    return replace(chosen, **observed)


def check_messages(spec: TaskSpec, recorded: TaskSpec) -> None:
    """Refuses models whose learned messages the recorded actions do not hold.

    Raises:
        SpecError: none were recorded, or of another size.
    """
    model = spec.communication
    if not isinstance(model, Broadcast) or model.payload != "learned":
        return
    if spec.action_size != recorded.action_size:
        got = recorded.action_size - 2
        there = f"messages of {got} values" if got else "none"
        raise SpecError(
            f"the view asks for learned messages of {model.message_size} values. They are part of "
            f"the recorded actions, which hold {there} ({describe(recorded)}). Choose another "
            "payload, such as pose, or a dataset whose policies learned to talk."
        )


def actions_for(spec: TaskSpec, recorded: TaskSpec, actions: Float) -> Float:
    """The part of the recorded actions [R, N, A] that belongs to the models of `spec`.

    Raises:
        SpecError: learned messages are wanted that were not recorded, or are of another size.
    """
    check_messages(spec, recorded)
    if spec.action_size == recorded.action_size:
        return actions
    commands = np.ascontiguousarray(actions[..., : spec.action_size])
    commands.setflags(write=False)
    return commands


def observe_tracks(
    task: Task, tracks: Tracks, *, n_copies: int = N_COPIES, progress: bool = True
) -> dict[str, NDArray[Any]]:
    """Runs the observer over recorded episodes; returns the arrays `OBSERVED`, read-only.

    Episodes of similar length run side by side, so that few copies wait for others to end.

    Args:
        task: the task with the models to observe by.
        tracks: the episodes.
        n_copies: episodes observed together; the result does not depend on it.
        progress: whether to show a bar.
    """
    n_copies = max(1, min(n_copies, len(tracks.lengths)))
    observer, n_agents = Observer(task, n_copies), task.spec.n_agents
    desk = _Desk(observer, tracks, n_copies, n_agents)
    order = np.argsort(-tracks.lengths, kind="stable")
    hidden = None if progress else True  # None: hidden where there is no terminal
    total = len(tracks.states)
    with tqdm(total=total, desc="observing", unit="state", unit_scale=True, disable=hidden) as bar:
        for first in range(0, len(order), n_copies):
            bar.update(desk.observe(order[first : first + n_copies]))
    for array in desk.results.values():
        array.setflags(write=False)
    return desk.results


class _Desk:
    """One step of all copies, into which recorded rows are laid and from which results are taken.

    Args:
        observer: of `n_copies` copies.
        tracks: the episodes.
        n_copies: E.
        n_agents: N.

    Attributes:
        results: flat arrays by name, a row for each state, filled by `observe`.
    """

    def __init__(
        self,
        observer: Observer,
        tracks: Tracks,
        n_copies: int,
        n_agents: int,
    ) -> None:
        self._observer, self._tracks = observer, tracks
        self._actions = np.zeros((n_copies, *tracks.actions.shape[1:]), dtype=np.float32)
        self._active: Bool = np.zeros(n_copies, dtype=np.bool_)
        fields: dict[str, Any] = dict(
            zip(OBSERVED, observer.allocate((n_copies,), n_agents), strict=True)
        )
        self._now = Step(
            states=np.zeros((n_copies, tracks.states.shape[1]), dtype=np.float32),
            rewards=np.zeros((n_copies, n_agents), dtype=np.float32),
            terminations=np.zeros(n_copies, dtype=np.bool_),
            truncations=np.zeros(n_copies, dtype=np.bool_),
            successes=np.zeros(n_copies, dtype=np.bool_),
            events=np.zeros((n_copies, n_agents, 4), dtype=np.uint8),
            seeds=np.zeros(n_copies, dtype=np.uint64),
            times=np.zeros(n_copies, dtype=np.int64),
            layouts=np.zeros((n_copies, *tracks.layouts.shape[1:]), dtype=np.float32),
            **fields,
        )
        # not zeroed: every row is written
        self.results: dict[str, NDArray[Any]] = {
            name: np.empty((len(tracks.states), *field.shape[1:]), dtype=field.dtype)
            for name, field in fields.items()
        }
        # an array without elements, as of robots that do not talk, has nothing to take
        self._pairs = [(self.results[k], field) for k, field in fields.items() if field.size]

    def observe(self, episodes: Int) -> int:
        """Observes at most E episodes, longest first, from beginning to end; returns their rows."""
        tracks, now, n = self._tracks, self._now, len(episodes)
        starts, lengths = tracks.starts[episodes], tracks.lengths[episodes]
        now.seeds[:n] = tracks.seeds[episodes]
        now.layouts[:n] = tracks.layouts[episodes]
        self._active[:n], self._active[n:] = True, False
        self._lay(starts + episodes, 0)
        self._observer.observe(now, None, self._active, np.arange(n))
        self._take(starts + episodes)
        for t in range(1, int(lengths[0]) + 1):
            n = int(np.searchsorted(-lengths, -t, side="right"))  # those with a state t
            self._active[n:] = False
            rows = starts[:n] + (t - 1)
            np.take(tracks.actions, rows, axis=0, out=self._actions[:n], mode="clip")
            rows = rows + episodes[:n] + 1
            self._lay(rows, t)
            self._observer.observe(now, self._actions, self._active)
            self._take(rows)
        return int(lengths.sum()) + len(episodes)

    def _lay(self, rows: Int, t: int) -> None:
        np.take(self._tracks.states, rows, axis=0, out=self._now.states[: len(rows)], mode="clip")
        self._now.times[: len(rows)] = t

    def _take(self, rows: Int) -> None:
        for result, source in self._pairs:
            result[rows] = source[: len(rows)]


def lossless(spec: TaskSpec) -> TaskSpec | None:
    """The same spec with a channel that loses nothing on air, None where robots do not talk."""
    model = spec.communication
    if not isinstance(model, Broadcast):
        return None
    clear = {"drop_probability": 0.0, "bursts": None, "slots_in_step": None}
    return spec.with_updates(communication=model.model_copy(update=clear))


def attempted_links(episode: Episode, spec: TaskSpec) -> Bool | None:
    """Links over which a message would have arrived had none been lost, [T + 1, N, N] or None."""
    clear = lossless(spec)
    return None if clear is None else reobserve_episode(episode, make_task(clear))["delivered"]
