"""Dataset, recorded episodes that are read lazily: open, select, iterate, sample, score."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from swarmdata.datasets.normalization import Moments
from swarmdata.datasets.sampling import Sampler, copy_transitions
from swarmdata.datasets.views import View
from swarmdata.errors import MissingFileError, SchemaError, check_type
from swarmdata.registry.published import Reference
from swarmdata.specs.model_choice import Source, chosen_models
from swarmdata.specs.origins import RecordedSpec, SideSpec
from swarmdata.specs.rules import changed_weights
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.store import StoredDataset, open_store
from swarmdata.store.arrays.layout import CARD
from swarmdata.store.stored_dataset import Verify
from swarmdata.store.table import team_returns
from swarmdata.types import END_REASONS, Column, Episode, Int, shortened

if TYPE_CHECKING:
    from swarmdata.datasets.reobservation import Reobservation
    from swarmdata.datasets.reweighting import OtherRewards, RewardFunction


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Dataset(View[Sampler]):
    """Episodes of one recorded dataset, all of them or a selection; nothing is copied.

    Every array is a read-only view of a memory map, except those that `reobserve` and
    `with_rewards` computed.

    Attributes:
        stored: the open files; of a reobservation or reweighting, with the arrays it computed.
        selection: stored episodes of this subset, int64 [n].
        references: anchors of the normalized score, if known.
        source: where the files came from, for example `folder`, `cache` or `rebuilt`.
        reobservation: with which sensors and radios this was observed again, if it was.
        reweighting: how the rewards were computed again, if they were.
        side_view: of which side the rows are, if not of all agents.
    """

    stored: StoredDataset
    selection: Int
    references: Reference | None = None
    source: str = "folder"
    reobservation: "Reobservation | None" = None
    reweighting: "OtherRewards | None" = None
    side_view: "SideView | None" = None

    @classmethod
    def open(
        cls,
        path: Path | str,
        verify: Verify = "fast",
        references: Reference | None = None,
        source: str = "folder",
    ) -> "Dataset":
        """Opens the folder of a finished dataset.

        Args:
            path: the folder.
            verify: `fast` checks the fast checksum of every chunk, `full` also every SHA-256,
                `none` neither.
            references: anchors of the normalized score.
            source: where the files came from; only kept.

        Raises:
            DatasetError: a subclass that names the file that cannot be used.
        """
        check_type("path", path, (str, Path), "the folder of a dataset")
        stored = open_store(Path(path), verify)
        return cls(stored, np.arange(len(stored.table)), references, source)

    @property
    def path(self) -> Path:
        """Folder of the dataset."""
        return self.stored.path

    @property
    def _rows(self) -> StoredDataset:
        return self.stored

    @property
    def _observed(self) -> TaskSpec | None:
        return None if self.reobservation is None else self.reobservation.spec

    def _changes(self) -> dict[str, Any]:
        # not `super()`: it has no class cell where a dataclass has slots
        rewards = {} if self.reweighting is None else {"rewards": self.reweighting.changes}
        side = {} if self._side is None else {"side": self._side.side}
        return {**View._changes(self), **rewards, **side}

    @property
    def _side(self) -> SideSpec | None:
        return None if self.side_view is None else self.side_view.spec

    @property
    def _other_views(self) -> "list[Reobservation | OtherRewards | SideView]":
        """What makes this another view than that of the recording."""
        views = (self.side_view, self.reobservation, self.reweighting)
        return [each for each in views if each is not None]

    @property
    def card(self) -> str:
        """Text of the dataset's card, Markdown; with notes about changed models and weights.

        Raises:
            MissingFileError: the dataset has no card.
        """
        try:
            text = (self.path / CARD).read_text(encoding="utf-8")
        except FileNotFoundError as error:
            raise MissingFileError(
                f"{self.path / CARD} is absent: this dataset has no card yet. "
                f"`swarmdata generate {self.id}` writes one."
            ) from error
        return "\n".join([*(each.note for each in self._other_views), text])

    @property
    def moments(self) -> Moments:
        """Exact moments of the train split, from which algorithms of this library learn."""
        if self.side_view is not None:
            return self.side_view.moments
        moments = Moments.of(self.stored.manifest.statistics)
        if self.reobservation is not None:
            mean, std = self.reobservation.moments
            moments = replace(moments, observation_mean=mean, observation_std=std)
        if self.reweighting is not None:
            reward_mean, reward_std = self.reweighting.moments
            moments = replace(moments, reward_mean=reward_mean, reward_std=reward_std)
        return moments

    @property
    def _has_other_rewards(self) -> bool:
        return self.reweighting is not None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickles the folder and the selection; other processes map the files themselves."""
        if self.side_view is not None:
            whole = replace(self.side_view.whole, selection=self.selection)
            return methodcaller("side", self.side_view.spec.side), (whole,)
        if self.reobservation is None and self.reweighting is None:
            return Dataset, (self.stored, self.selection, self.references, self.source)
        from swarmdata.datasets.pickled_views import pickled  # noqa: PLC0415  (rarely needed)

        return pickled(self)

    def __repr__(self) -> str:
        whole = len(self.stored.table)
        part = "" if len(self) == whole else f" of {whole:,}"
        models = "".join(f" {each.summary};" for each in self._other_views)
        sizes = f"{len(self):,}{part} episodes, {self.n_steps:,} steps, {self.spec.n_agents} agents"
        last = f"digest {self.digest[:12]}, at {self.path}"
        return shortened(f"<Dataset {self.id}:{models} {sizes}, {last}>")

    def __getitems__(self, indices: Sequence[int]) -> list[Episode]:
        """Returns some episodes, as a torch `DataLoader` asks for them."""
        from swarmdata.datasets.torch_batches import explain_stacking  # noqa: PLC0415  (torch)

        explain_stacking()
        return [self[index] for index in indices]

    def reobserve(
        self,
        observation: Source | None = None,
        communication: Source | None = None,
        *,
        progress: bool = True,
    ) -> "Dataset":
        """Returns the same episodes as robots with other sensors and radios would observe them.

        Observations, `sent`, `delivered` and `ages` are computed from the recorded states by the
        code of live worlds, for the whole dataset. Rewards, states, actions and the digest stay
        those of the recording. `statistics`, `spec` and `make_env` follow the new models.

        The new arrays have 4 N (O + P) + 2 N^2 bytes per state (N^2 and P with a channel only):
        1.1 GB for a million states of four robots with 16 lidar rays. More than 256 MiB are in
        nameless files in the folder of the cache, deleted with the last dataset that uses them.

        Args:
            observation: the new model: its fields, a file, or a name such as `lidar`,
                `lidar-32+noise-0.05`, `bearing` or `occupancy`, which modifies this dataset's
                unless "=" stands before it; None keeps this dataset's.
            communication: the new channel, given likewise, such as `perfect`, `none` or
                `lossy-30+range-1.5`.
            progress: whether to show a bar (on standard error, if that is a terminal).

        Raises:
            UnknownNameError: no such model.
            SpecError: a malformed model, or learned messages that were not recorded.
        """
        if observation is None and communication is None:
            return self
        self._check_whole("reobserve")
        spec = chosen_models(self.task, observation, communication)
        if spec == self.spec:
            return self
        recorded = self.stored if self.reobservation is None else self.reobservation.recorded
        if spec == self.recipe.spec:
            return replace(self, stored=self._rewarded(recorded), reobservation=None)
        from swarmdata.datasets.reobservation import reobserve  # noqa: PLC0415  (compiled code, rarely needed)

        reobserved = reobserve(recorded, spec, progress=progress)
        stored = self._rewarded(replace(recorded, arrays=dict(reobserved.arrays)))
        return replace(self, stored=stored, reobservation=reobserved)

    def _rewarded(self, stored: StoredDataset) -> StoredDataset:
        """Other files with the rewards and returns of this subset."""
        names = ("rewards", "episodes/team_return")
        return stored.with_arrays({name: self.stored.arrays[name] for name in names})

    def with_rewards(
        self, function: "RewardFunction | None" = None, /, **weights: float | str
    ) -> "Dataset":
        """Returns the same episodes with rewards of other weights, or of a function.

            >>> dataset.with_rewards(robot_collision=2.0)
            >>> dataset.with_rewards(lambda episode: -np.abs(episode.actions).sum(axis=2))

        With weights, the rewards are computed from the stored `reward_terms` as worlds compute
        them, so the recorded weights give the recorded rewards bit for bit. Returns, `statistics`
        and batches follow the new rewards. `spec`, `make_env` and `references` stay those of the
        task; the new returns have no score, and `normalized_score` refuses them.

        The new rewards have 4 N bytes per step; more than 256 MiB are in a file without a name, as
        those of `reobserve` are.

        Args:
            function: gets each `Episode` of the whole dataset as this view has it, and returns
                each robot's reward in each step, [T, N]. It is called now, and not kept: `view`
                has its name and the SHA-256 of its rewards.
            weights: new weights of terms by name, such as `robot_collision=2.0`, or `team_share`;
                the others stay as they are, or those of the recording after a function.
                `dataset.task.rules.rewards` has the recorded.

        Raises:
            UnknownNameError: no such weight; the message lists those that exist.
            SpecError: a weight cannot have the value, or the dataset is of another environment.
            SchemaError: the dataset has no terms, it is no function or gives other than finite
                rewards of each robot in each step, or there are both a function and weights.
        """
        if function is None and not weights:
            return self
        self._check_whole("with_rewards")
        from swarmdata.datasets.reweighting import Reweighting, relabel, reweight  # noqa: PLC0415  (compiled code, rarely needed)

        if function is not None:
            if not callable(function):
                raise SchemaError(
                    f"with_rewards got {function!r:.100}, expected a function of an episode, or "
                    "weights as keywords, such as robot_collision=2.0"
                )
            if weights:
                raise SchemaError(
                    f"with_rewards got a function and weights of {', '.join(weights)}, expected "
                    "one of them: add the weighted `episode.reward_terms` in the function."
                )
            episodes = map(self._episode, range(len(self.stored.table)))
            labels = relabel(self.stored, episodes, function)
            return replace(self, stored=labels.stored, reweighting=labels)
        now, before = self.task.rules.rewards, self.reweighting
        if isinstance(before, Reweighting):
            now = before.weights
        found = reweight(self.stored, changed_weights(now, weights))
        return replace(self, stored=found.stored, reweighting=found if found.changes else None)

    def side(self, name: str) -> "Dataset":
        """Returns the same episodes with the agents of one side alone.

        Observations, actions, rewards and events have the rows of these agents; returns and
        successes are those of the side, and an `end_reason` says whether it succeeded. States,
        terminations, truncations and the collisions of the episode table are those of all sides.
        Nothing is copied. Policies that learn from it act for their side: `evaluate` takes them
        with `opponents`.

            >>> dataset.side("pursuers").sampler(256)

        Args:
            name: of the side, as `dataset.task.sides` lists them.

        Raises:
            UnknownNameError: the task has no such side.
            SpecError: the task has one side only, or the dataset is of another environment.
            SchemaError: this is one side already.
        """
        self._check_whole("side")
        found = _side_view(self, name)
        return replace(self, stored=found.stored, references=None, side_view=found)

    def _check_whole(self, method: str) -> None:
        """Refuses what needs the rows of all agents."""
        if self.side_view is not None:
            raise SchemaError(
                f"{method} needs the rows of all agents, but {self!r} has those of one side. Call "
                f"{method} on the whole dataset, and take the side last."
            )

    def columns(self, array: str, agent: int = 0) -> tuple[Column, ...]:
        """Returns what each number in a row of an array means: name, meaning, unit, bounds.

            >>> [column.name for column in dataset.columns("states")]

        Args:
            array: `observations`, `states`, `actions`, `reward_terms`, `events`, `sent` or
                `layout`; those of a reobservation are of its models. Of a recording or of logs
                `observations` or `actions`, which have names and bounds alone.
            agent: whose columns; only teams of different robots need it.

        Raises:
            UnknownNameError: no such array has columns.
            SchemaError: there is no such agent.
            SpecError: another package defines the task, which is not installed.
        """
        if isinstance(self.spec, RecordedSpec):
            return self.spec.columns(array, agent)
        from swarmdata.registry.components import make_task  # noqa: PLC0415  (the task's code)
        from swarmdata.store.arrays.column_meanings import columns_of  # noqa: PLC0415

        return columns_of(make_task(self.task), array, agent)

    def transitions(self) -> dict[str, NDArray[Any]]:
        """Copies every transition of this subset into memory, row-aligned.

        The last transition of every episode is kept; its `next_observations` and `next_states` are
        those of its final state. `episodes` has the index of each row's episode in this subset.

        Returns:
            observations, next_observations [n, N, O]; states, next_states [n, S]; actions
            [n, N, A]; log_probs, rewards [n, N]; costs [n, N, C], if events were recorded; alive,
            agent_terminations, agent_truncations [n, N], if agents can leave; terminations,
            truncations, episodes [n]. Actions and rewards of agents that are not alive are 0.
        """
        lengths = self.stored.table.lengths[self.selection]
        copied = copy_transitions(self.stored.arrays, self.stored.table, self.selection)
        return {**copied, "episodes": np.repeat(np.arange(len(self)), lengths)}

    def _sampler(self, **sizes: Any) -> Sampler:
        stored, scale = self.stored, self._action_scale()
        return Sampler(stored.arrays, stored.table, self.selection, scale=scale, view=self, **sizes)

    def replay_buffer(
        self, batch_size: int | None = 256, *, slice_length: int | None = None,
        keys: Sequence[tuple[str, ...] | str] | None = None,
    ) -> Any:  # fmt: skip
        """Returns a TorchRL replay buffer of this subset's transitions, in memory.

        Keys are those of TorchRL's multi-agent environments, such as ("agents", "observation") and
        ("next", "agents", "reward"); actions are as they were recorded.

        Args:
            batch_size: number of transitions of a sample; None: `sample` is told it each time.
            slice_length: samples consist of so many consecutive steps of one episode, a divisor of
                `batch_size`; None: single transitions.
            keys: to sample, such as those that an environment's transitions have too; None: all.

        Raises:
            MissingExtraError: TorchRL is not installed.
            SchemaError: the subset has no episodes, or the transitions lack a key.
        """
        from swarmdata.registry.components import REPLAY_BUFFERS, resolve  # noqa: PLC0415

        make = resolve("replay buffer", REPLAY_BUFFERS, "torchrl")
        return make(self, batch_size, slice_length, keys)


@dataclass(frozen=True, eq=False, repr=False)
class SideView:
    """The rows of one side."""

    whole: Dataset  # with the rows of all sides
    stored: StoredDataset  # the same files with the rows of this side
    spec: SideSpec

    @property
    def summary(self) -> str:
        """A few words."""
        return f"the {self.spec.side} alone"

    @property
    def note(self) -> str:
        """One paragraph about the side, Markdown."""
        return (
            f"> **This is one side**, the {self.spec.side}, with their observations, actions, "
            "rewards, returns and successes; states are those of all robots. The card below "
            "describes the whole dataset.\n"
        )

    @cached_property
    def moments(self) -> Moments:
        """Moments of the side's observations and rewards over the train split."""
        from swarmdata.store.arrays.running_moments import train_moments  # noqa: PLC0415  (rarely needed)

        mean, std = train_moments(self.stored, "observations")
        (reward_mean,), (reward_std,) = train_moments(self.stored, "rewards")
        return Moments(mean, std, float(reward_mean), float(reward_std))


def _side_view(whole: Dataset, name: str) -> SideView:
    """The rows of one side; only rewards are read."""
    from swarmdata.rollouts.side_policy import (  # noqa: PLC0415  (compiled code, rarely needed)
        AGENT_ARRAYS,
        PAIR_ARRAYS,
        end_reason_for,
        rows_of_side,
    )

    task, stored = whole.task, whole.stored
    side = task.side(name)
    arrays = {
        each: rows_of_side(each, stored.arrays[each], side)
        for each in (*AGENT_ARRAYS, *PAIR_ARRAYS)
        if each in stored.arrays
    }
    codes = stored.table.end_reason.tolist()
    ends = np.array([end_reason_for(side, code) for code in codes], dtype=np.uint8)
    columns = {
        "episodes/team_return": team_returns(stored.table, arrays["rewards"]),
        "episodes/end_reason": ends,
        "episodes/success": ends == END_REASONS.index("success"),
    }
    for column in columns.values():
        column.setflags(write=False)
    seen = stored.with_arrays({**arrays, **columns})
    return SideView(whole, seen, SideSpec(whole=task, side=name))
