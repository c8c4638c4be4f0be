"""Recorder, a PettingZoo `ParallelEnv` that records what passes through it as a dataset."""

import warnings
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from pettingzoo.utils import BaseParallelWrapper

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, UnknownNameError
from swarmdata.record.episode_buffer import StepRow, Tape
from swarmdata.record.foreign_environment import agents_of
from swarmdata.record.recording_description import describe, is_ours, state_source
from swarmdata.record.reset_seeds import SeedStream, default_seed
from swarmdata.record.row_reader import Reader
from swarmdata.record.rows import Rows
from swarmdata.record.session import Limits, RecordingFolder, Session
from swarmdata.specs.recipe import PolicySource, Splits


class UnfinishedEpisodeWarning(UserWarning):
    """An episode that had not ended is not in the recording."""


class Recorder(BaseParallelWrapper):
    """Records every episode that is played through it, and is used like the environment itself.

        with swarmdata.Recorder(env, id="simple_spread_v3-mine-v0", path="mine") as recorder:
            for _ in range(100):
                observations, infos = recorder.reset()
                while recorder.agents:
                    actions = {agent: ... for agent in recorder.agents}
                    observations, rewards, _, _, _ = recorder.step(actions)
        dataset = recorder.close()

    Values are copied as the environment and the policies give them, as float32. Finished episodes
    are written to `<path>.recording/` now and then; a process that is killed loses at most those
    since (see `limits`), and a new Recorder with the same arguments goes on. `close` makes the
    dataset. A task of this library (`ParallelWorld`) keeps its spec, events and messages.

    Args:
        env: any `ParallelEnv`, not wrapped again afterwards.
        id: of the dataset: `<task>[-<variant>]-<name>-v<k>`.
        path: the dataset's folder, which must not exist.
        policies: labels of the policies that act, or more about them; each episode is by one.
        task: name of the environment; by default that in its metadata.
        options: that it was made with, JSON values; for those who want to make it again.
        horizon: most steps of an episode; by default the environment's `max_cycles`, if it has one.
        metadata: what readers should know: `author`, `license`, `description`, `code` and others.
        seed: of the splits, and of resets without a seed; by default one that follows from `id`.
        splits: how many episodes are held out.
        state: where states come from: the environment's `state()`, all observations in one, or
            `auto`, which takes the first if the environment has it.
        log_probs: whether `record_log_probs` is called before every step.
        keep_unfinished: whether an episode that is left by `reset` or `close` is kept as truncated.
        limits: of what may be lost when the process is killed.

    Raises:
        SpecError: the environment, the id or the metadata cannot be stored.
        BuildError: `path` exists, or another process records to it.
    """

    def __init__(
        self,
        env: Any,
        *,
        id: str,
        path: Path | str,
        policies: Sequence[str | PolicySource] = ("mine",),
        task: str | None = None,
        options: Mapping[str, Any] | None = None,
        horizon: int | None = None,
        metadata: Mapping[str, str] | None = None,
        seed: int | None = None,
        splits: Splits | None = None,
        state: Literal["auto", "environment", "observations"] = "auto",
        log_probs: bool = False,
        keep_unfinished: bool = False,
        limits: Limits | None = None,
    ) -> None:
        super().__init__(env)
        if Path(path).exists():
            raise BuildError(
                f"{path} exists. Record to another path, or delete it; a published version never "
                "changes, so give the dataset a new one."
            )
        seed = default_seed(id) if seed is None else seed
        self._recording = describe(
            env, id, policies, task, options, horizon, metadata, seed, splits or Splits()
        )
        self._labels = [source.label for source in self._recording.policies]
        self._reader = Reader(tuple(env.possible_agents), agents_of(env))
        self._state, self._has_log_probs, self._keeps = state, log_probs, keep_unfinished
        self._folder = RecordingFolder(Path(path), limits)
        # a script that ends without closing loses nothing either; needs a part of this only
        self._saved = weakref.finalize(self, self._folder.flush)
        self._seeds = SeedStream(seed, self._folder.seeds())
        self._rows: Rows | None = None
        self._tape: Tape | None = None
        self._policy = 0
        self._log_probs: Mapping[Any, float] | None = None
        self._dataset: Dataset | None = None

    @property
    def n_episodes(self) -> int:
        """Finished episodes of this recording, those of earlier processes included."""
        return self._folder.n_episodes

    def set_policy(self, label: str) -> None:
        """Says which policy acts from the next step on, until another one is named.

        Raises:
            UnknownNameError: the recorder was not made with this policy.
            SchemaError: the episode has steps of another policy.
        """
        if label not in self._labels:
            raise UnknownNameError("policy of the recorder", label, self._labels)
        index = self._labels.index(label)
        if self._tape is not None:
            if len(self._tape) and self._tape.policy != index:
                raise SchemaError(
                    f"the episode has {len(self._tape)} steps of policy "
                    f"{self._labels[self._tape.policy]!r}, so {label!r} cannot act in it. Name the "
                    "policy before the first step of an episode."
                )
            self._tape.policy = index
        self._policy = index

    def record_log_probs(self, log_probs: Mapping[Any, float]) -> None:
        """Takes the log-probability of the action that each agent takes in the next step.

        Args:
            log_probs: by agent; of agents that are not alive they are not needed.

        Raises:
            SchemaError: the recorder was made without `log_probs=True`.
        """
        if not self._has_log_probs:
            raise SchemaError(
                "this recorder keeps no log-probabilities: make it with log_probs=True, and give "
                "them before every step."
            )
        self._log_probs = dict(log_probs)

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
        *,
        policy: str | None = None,
    ) -> tuple[dict[Any, Any], dict[Any, Any]]:
        """Starts an episode.

        Args:
            seed: passed on and recorded; without one a new one is drawn.
            options: passed on; they are not recorded.
            policy: label of the one that acts from now on.

        Raises:
            SchemaError: the seed is reserved, or something does not fit the spaces.
            RecipeConflictError: the recording begun at this path is of something else.
        """
        if self._dataset is not None:
            raise BuildError(f"the recording is closed: {self._dataset!r}")
        self._leave_episode()
        used = self._seeds.draw() if seed is None else self._seeds.take(seed)
        if policy is not None:
            self.set_policy(policy)
        observations, infos = self.env.reset(seed=used, options=options)
        rows = self._rows = self._rows or self._begin(observations, infos)
        alive = self._reader.alive(self.env.agents)
        first = rows.state(observations, infos, alive, alive)
        self._tape = Tape(used, self._policy, rows.layout(), [first])
        self._log_probs = None
        return observations, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any]]:
        """Takes one step of the environment and records it.

        Raises:
            SchemaError: no episode runs, or something does not fit the spaces or is not finite.
        """
        tape, rows, reader = self._tape, self._rows, self._reader
        if tape is None or rows is None:
            raise SchemaError("no episode is running; call reset() first")
        acted = tape.states[-1].alive
        taken = reader.actions(actions, acted)  # a copy, before the environment can change them
        log_probs = self._taken_log_probs(acted)
        self._tape = None  # if this fails, the episode is lost: it no longer fits the environment
        result = self.env.step(actions)
        observations, rewards, terminations, truncations, infos = result
        ends = reader.flags(terminations, acted), reader.flags(truncations, acted)
        alive = reader.alive(self.env.agents) & ~ends[0] & ~ends[1]
        step = StepRow(
            actions=taken,
            log_probs=log_probs,
            rewards=reader.numbers(rewards, acted, "reward"),
            terminations=ends[0],
            truncations=ends[1] & ~ends[0],
            events=rows.events(),
        )
        tape.add(step, rows.state(observations, infos, alive, acted | alive))
        if alive.any():
            self._tape = tape
        else:
            self._keep(tape, infos)
        return result

    def close(self) -> Dataset:
        """Finishes the recording, closes the environment and returns the dataset.

        Again called, it returns the same.

        Raises:
            BuildError: no episode was finished, or none falls into the train split. What was
                recorded is kept.
        """
        if self._dataset is None:
            try:
                self._leave_episode()
                self._dataset = self._folder.finish()
            finally:
                self._let_go()
        return self._dataset

    def pause(self) -> None:
        """Writes the finished episodes and lets go: a later Recorder can go on, here or elsewhere.

        This one cannot be used any more.
        """
        self._leave_episode()
        self._folder.flush()
        self._let_go()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Closes; after an error it pauses, so that the finished episodes are not lost."""
        if kind is None:
            self.close()
        elif self._dataset is None:
            self.pause()

    def _let_go(self) -> None:
        self._saved.detach()
        self._folder.release()
        self.env.close()

    def _begin(self, observations: Mapping[Any, Any], infos: Mapping[Any, Any]) -> Rows:
        """Completes the description with what only a reset shows, and begins or goes on."""
        has_masks = self._reader.has_masks(observations, infos)
        if is_ours(self.env):
            source: Literal["environment", "observations"] = "environment"
            recording = self._recording
        else:
            source, size = state_source(self.env, self._reader, self._state)
            spec = self._recording.spec.model_copy(
                update={"state_size": size, "state_from": source}
            )
            recording = self._recording.model_copy(update={"spec": spec})
        self._folder.claim(
            Session(recording=recording, log_probs=self._has_log_probs, masks=has_masks)
        )
        return Rows(self.env, self._reader, recording.spec, source, has_masks)

    def _taken_log_probs(self, acted: Any) -> Any:
        if not self._has_log_probs:
            return np.zeros(0, np.float32)
        given, self._log_probs = self._log_probs, None
        if given is None:
            raise SchemaError("call record_log_probs before every step")
        return self._reader.numbers(given, acted, "log-probability")

    def _keep(self, tape: Tape, infos: Mapping[Any, Any], *, is_cut: bool = False) -> None:
        outcome = None if is_cut else self._reader.outcome(infos)
        self._folder.add(tape.episode(outcome, is_cut=is_cut))
        self._tape = None

    def _leave_episode(self) -> None:
        """Keeps or drops the running episode."""
        tape, self._tape = self._tape, None
        if tape is None or not len(tape):
            return
        if self._keeps:
            self._keep(tape, {}, is_cut=True)
            return
        warnings.warn(
            f"an episode of {len(tape)} steps had not ended and is not recorded; "
            "keep_unfinished=True keeps such episodes as truncated",
            UnfinishedEpisodeWarning,
            stacklevel=3,
        )
