"""Recorder: a PettingZoo `ParallelEnv` that records what passes through it as a dataset."""

import warnings
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import compress
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from pettingzoo.utils import BaseParallelWrapper

from swarmdata.datasets.dataset import Dataset
from swarmdata.errors import BuildError, SchemaError, UnknownNameError
from swarmdata.record.agent_reader import AgentReader, Presence
from swarmdata.record.episode_buffer import EpisodeBuffer, Row
from swarmdata.record.joint_environment import as_parallel
from swarmdata.record.recording_description import (
    StateSource,
    describe_agents,
    describe_environment,
    is_own_task,
    make_recording,
    state_source,
)
from swarmdata.record.recording_folder import Limits, RecordingFolder, Session
from swarmdata.record.reset_seeds import SeedStream
from swarmdata.runtime.atomic import is_vacant
from swarmdata.specs.origins import Spec
from swarmdata.specs.recipe import PolicySource, Splits
from swarmdata.specs.spaces import to_float32
from swarmdata.types import Bool, Float, FloatOrByte, Step, no_messages


class UnfinishedEpisodeWarning(UserWarning):
    """An episode was left before its end and is not recorded."""


@dataclass(frozen=True, slots=True, eq=False)
class EnvironmentReader:
    """Reads an environment after a reset or step."""

    env: Any  # a `ParallelEnv`; a `ParallelWorld` if it is a task of this library
    reader: AgentReader  # reads values by agent
    spec: Spec  # the recording's spec
    source: StateSource  # where states come from
    has_masks: bool  # whether the recording has action masks

    @property
    def own_step(self) -> Step | None:
        """The step of a task of this library, with events, messages and a layout; else None."""
        return None if self.spec.world is None else self.env.current_step

    def state(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool, seen: Bool
    ) -> Row:
        """The state that was reached.

        Agents `alive`, [N], act next; those `seen`, [N], act next or acted in the step before.
        """
        rows, concatenated = self.reader.observations(observations, seen)
        messages, own = no_messages(len(alive)), self.own_step
        if own is not None:
            messages = {name: getattr(own, name)[0].copy() for name in messages}
        return {
            "observations": rows,
            "states": self._state(concatenated),
            "alive": alive,
            "action_masks": self._masks(observations, infos, alive),
            **messages,
        }

    def _state(self, concatenated: FloatOrByte) -> FloatOrByte:
        """The state, [S], given the concatenated observations; an image of bytes stays uint8."""
        if self.source == "observations":
            return concatenated
        try:
            state = np.array(self.env.state())  # a copy: it may be written in place later
        except Exception as error:  # a foreign environment may raise anything
            raise SchemaError(
                f"state() of {self.env} failed after it had worked before: {error!r}. Some "
                "environments have no state at the end of an episode; record all observations "
                "instead with state='observations'."
            ) from error
        row: FloatOrByte = state.reshape(-1)
        if state.dtype != np.uint8:
            row = to_float32(row, "state()")
        if self.spec.state_size not in (None, len(row)):
            raise SchemaError(
                f"state() returned {len(row)} numbers, expected {self.spec.state_size} as after "
                "the first reset"
            )
        return row

    def _masks(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any], alive: Bool
    ) -> Bool | None:
        if self.has_masks:
            return self.reader.masks(observations, infos, alive)
        if self.reader.has_masks(observations, infos):
            raise SchemaError(
                "an action mask appeared after the first reset had none, so earlier states have no "
                "masks. Let the environment give masks from its first reset on."
            )
        return None


class Recorder(BaseParallelWrapper):
    """Records every episode played through it; used like the environment itself.

    Values are stored as float32 copies of those that pass through. Finished episodes are written to
    `<path>.recording/` from time to time. A killed process loses at most the episodes since the
    last write (see `limits`), and a new Recorder with the same arguments continues the recording.
    `close` makes the dataset. A task of this library (`ParallelWorld`) keeps its spec, events and
    messages.

    Args:
        env: any `ParallelEnv`, a parallelizable `AECEnv`, or a Gymnasium environment, whose agent
            is called `agent_0`; do not wrap the recorder again.
        id: id of the dataset, `<task>[-<variant>]-<name>-v<k>`.
        path: folder of the dataset, which must not exist.
        policies: labels or descriptions of the policies that act, one in each episode; the dataset
            has the episodes of one after the other, in the order of recording.
        task: name of the environment; by default the one in its metadata.
        options: JSON values that the environment was made with, so that others can make it again.
        horizon: most steps of an episode; by default the environment's `max_cycles`, or the
            `max_episode_steps` of its Gymnasium spec, if it has one.
        metadata: information for readers, such as `author`, `license`, `description` and `code`.
        seed: seed of the splits and of resets without a seed; by default derived from `id`.
        splits: how many episodes are held out.
        state: source of states: `environment` (its `state()`), `observations` (all of them,
            concatenated), or `auto`, which prefers the environment's.
        log_probs: whether `record_log_probs` is called before every step.
        keep_unfinished: whether an episode that `reset` or `close` interrupts is kept, as
            truncated.
        limits: when finished episodes are written.

    Raises:
        SpecError: the environment, the id or the metadata cannot be stored.
        UnknownNameError: `state` is another word.
        BuildError: `path` exists, or another process is recording to it.
    """

    _presence: Presence  # of the agents of the running episode

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
        if state not in (known := ("auto", "environment", "observations")):
            raise UnknownNameError("source of states", state, known)
        super().__init__(env := as_parallel(env))
        if not is_vacant(Path(path)):
            raise BuildError(
                f"{path} exists. Record to another path, or move it away; a published version "
                "never changes, so give a changed dataset a new version."
            )
        spec = describe_environment(env, task, options, horizon)
        self._recording = make_recording(spec, id, policies, metadata, seed, splits)
        self._labels = [source.label for source in self._recording.policies]
        self._reader = AgentReader(tuple(env.possible_agents), describe_agents(env))
        self._state, self._has_log_probs, self._keeps_unfinished = state, log_probs, keep_unfinished
        self._folder = RecordingFolder(Path(path), limits)
        # a script that ends without closing loses no finished episode
        self._flush_at_exit = weakref.finalize(self, self._folder.flush)
        self._seeds = SeedStream(self._recording.seed, self._folder.seeds())
        self._environment: EnvironmentReader | None = None
        self._buffer: EpisodeBuffer | None = None
        self._policy, self._has_warned = 0, False
        self._log_probs: Mapping[Any, float] | None = None
        self._dataset: Dataset | None = None

    @property
    def n_episodes(self) -> int:
        """Finished episodes of this recording, including those of earlier processes."""
        return self._folder.n_episodes

    def set_policy(self, label: str) -> None:
        """Sets the policy that acts from the next step on.

        Raises:
            UnknownNameError: the recorder was not made with this policy.
            SchemaError: the running episode has steps of another policy.
        """
        if label not in self._labels:
            raise UnknownNameError("policy of the recorder", label, self._labels)
        index = self._labels.index(label)
        if self._buffer is not None:
            if len(self._buffer) and self._buffer.policy != index:
                raise SchemaError(
                    f"the episode has {len(self._buffer)} steps of policy "
                    f"{self._labels[self._buffer.policy]!r}, so {label!r} cannot act in it. Set "
                    "the policy before the first step of an episode."
                )
            self._buffer.policy = index
        self._policy = index

    def record_log_probs(self, log_probs: Mapping[Any, float]) -> None:
        """Records the log-probability of each living agent's action in the next step.

        Raises:
            SchemaError: the recorder was made without `log_probs=True`.
        """
        if not self._has_log_probs:
            raise SchemaError(
                "this recorder keeps no log-probabilities: make it with log_probs=True, and call "
                "record_log_probs before every step."
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
            seed: passed on and recorded; drawn if None.
            options: passed on, not recorded.
            policy: label of the policy that acts from now on.

        Raises:
            SchemaError: the seed is reserved, or a value does not fit its space.
            RecipeConflictError: the unfinished recording at this path has another description.
        """
        if self._dataset is not None:
            raise BuildError(f"the recording is closed: {self._dataset!r}")
        self._leave_episode()
        used = self._seeds.draw() if seed is None else self._seeds.take(seed)
        if policy is not None:
            self.set_policy(policy)
        observations, infos = self.env.reset(seed=used, options=options)
        if self._environment is None:
            self._environment = self._begin(observations, infos)
        self._presence = Presence.after_reset(self._reader, self.env.agents)
        alive = self._presence.alive
        first = self._environment.state(observations, infos, alive, alive)
        own = self._environment.own_step
        layout = np.zeros((0, 8), np.float32) if own is None else own.layouts[0].copy()
        self._buffer = EpisodeBuffer(used, self._policy, layout, [first])
        self._log_probs = None
        return observations, infos

    def step(
        self, actions: dict[Any, Any]
    ) -> tuple[dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any], dict[Any, Any]]:
        """Takes one step of the environment and records it.

        An action that is not in its space is refused before the step, so that the episode can go
        on. Anything else that is refused costs its episode, and no other.

        Raises:
            SchemaError: no episode is running, a value does not fit its space or float32, or an
                agent leaves without a flag.
        """
        buffer, environment, reader = self._buffer, self._environment, self._reader
        if buffer is None or environment is None:
            raise SchemaError("no episode is running; call reset() first")
        acted: Bool = buffer.states[-1]["alive"]
        taken = reader.actions(actions, acted)  # a copy, before the environment can change them
        log_probs = self._pop_log_probs(acted)
        self._buffer = None  # after a failure, the episode no longer fits the environment
        result = self.env.step(actions)
        observations, rewards, terminations, truncations, infos = result
        self._warn_of_late_rewards(rewards, acted)
        ends = reader.flags(terminations, acted), reader.flags(truncations, acted)
        alive = self._presence.step(ends[0] | ends[1], self.env.agents, infos)
        own = environment.own_step
        step: Row = {
            "actions": taken,
            "log_probs": log_probs,
            "rewards": reader.numbers(rewards, acted, "reward"),
            "agent_terminations": ends[0],
            "agent_truncations": ends[1] & ~ends[0],
            "events": np.zeros((len(acted), 0), np.uint8) if own is None else own.events[0].copy(),
            "reward_terms": None if own is None else own.reward_terms[0].copy(),
        }
        buffer.states.append(environment.state(observations, infos, alive, acted | alive))
        buffer.steps.append(step)
        if alive.any():
            self._buffer = buffer
        else:
            self._folder.add(buffer.episode(self._presence.outcome))
        return result

    def close(self) -> Dataset:
        """Finishes the recording, closes the environment and returns the dataset.

        Further calls return the same dataset.

        Raises:
            BuildError: no episode was finished, or none falls into the train split. The recorded
                episodes are kept.
        """
        if self._dataset is None:
            try:
                self._leave_episode()
                self._dataset = self._folder.finish()
            finally:
                self._let_go()
        return self._dataset

    def pause(self) -> None:
        """Writes the finished episodes, so that another Recorder can continue in any process.

        This recorder cannot be used any more.
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
        """Closes the recording, or pauses it after an error, which keeps the finished episodes."""
        if kind is None:
            self.close()
        elif self._dataset is None:
            self.pause()

    def _let_go(self) -> None:
        self._flush_at_exit.detach()
        self._folder.release()
        self.env.close()

    def _begin(
        self, observations: Mapping[Any, Any], infos: Mapping[Any, Any]
    ) -> EnvironmentReader:
        """Completes the description after the first reset; begins or continues the recording."""
        has_masks = self._reader.has_masks(observations, infos)
        recording = self._recording
        source: StateSource = "environment"
        if not is_own_task(self.env):
            source, size = state_source(self.env, self._reader, self._state)
            states = {"state_size": size, "state_from": source}
            spec = recording.spec.model_copy(update=states)
            recording = recording.model_copy(update={"spec": spec})
        self._folder.claim(
            Session(recording=recording, log_probs=self._has_log_probs, masks=has_masks)
        )
        return EnvironmentReader(self.env, self._reader, recording.spec, source, has_masks)

    def _pop_log_probs(self, acted: Bool) -> Float:
        if not self._has_log_probs:
            return np.zeros(0, np.float32)
        given, self._log_probs = self._log_probs, None
        if given is None:
            raise SchemaError("call record_log_probs before every step")
        return self._reader.numbers(given, acted, "log-probability")

    def _warn_of_late_rewards(self, rewards: Mapping[Any, Any], acted: Bool) -> None:
        """Warns once of rewards of agents that did not act, [N], which are not recorded."""
        names = compress(self._reader.names, ~acted)
        late = [name for name in names if np.any(rewards.get(name, 0.0))]
        if late and not self._has_warned:
            self._has_warned = True
            warnings.warn(
                f"{late[0]} got the reward {rewards[late[0]]!r:.50} after its end, which is not "
                "recorded, nor are others of agents that do not act",
                stacklevel=3,
            )

    def _leave_episode(self) -> None:
        """Keeps or drops the running episode."""
        buffer, self._buffer = self._buffer, None
        if buffer is None or not len(buffer):
            return
        if self._keeps_unfinished:
            self._folder.add(buffer.episode(is_cut=True))
            return
        warnings.warn(
            f"an episode of {len(buffer)} steps had not ended and is not recorded; "
            "keep_unfinished=True keeps such episodes as truncated",
            UnfinishedEpisodeWarning,
            stacklevel=3,
        )
