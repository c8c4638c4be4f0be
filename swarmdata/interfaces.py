"""The protocols of tasks, environments, policies and algorithms: all that swarmdata asks of them.

Any class with these members will do; none has to be inherited. Axis letters are those of `types`.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, Protocol, runtime_checkable

from swarmdata.errors import SchemaError, UnknownNameError
from swarmdata.specs.features import Feature
from swarmdata.specs.rules import Payload
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import (
    Batch,
    Bool,
    Column,
    Double,
    Episode,
    Float,
    Int,
    Metric,
    Seeds,
    Step,
    Term,
)


@runtime_checkable
class Task(Protocol):
    """A task with the constants of one spec: pure functions over arrays, without physics.

    Four members are optional. `appearance(spec)`, a static method, says how the task is drawn, by a
    `registry.appearance.Appearance`. `definitions`, a mapping of names to texts, says on cards what
    the names of columns, terms and metrics stand for where a line is too short. `complete(states,
    copies)` writes the extras of states whose robots and targets are set: with it, logs of robots
    can be scored by the task. `controller`, a class, is the policy `scripted` of a task of another
    package.

    Built as `Task(spec)`. `state_layout` describes a row of the states: robots, movable bodies, and
    then the task's own numbers, whose columns are `extras`. Everything that these functions write
    depends only on an episode's states, layout, seed and times, so that it can be computed again
    from a dataset.
    """

    spec: TaskSpec
    kinds: Int  # [M] shape code of each row of a layout, the same in every episode
    movables: tuple[Payload, ...]  # bodies that robots can push
    extras: tuple[Column, ...]  # the task's own columns of a state
    features: tuple[Feature, ...]  # added by the task to every robot's observation
    terms: tuple[Term, ...]  # of the task's own reward; `components.reward_terms` returns all terms
    solved: str  # the condition under which the task is solved, as a clause
    metrics: ClassVar[Mapping[str, Metric]]  # added by the task to `metrics.EPISODE_METRICS`

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        """Draws new episodes: their obstacles, their initial states and the task's own numbers.

        Args:
            seeds: episode seeds, [len(copies)].
            copies: rows to write.
            layouts: written, [E, M, 8].
            states: written, [E, S].

        Raises:
            SpawnError: no collision-free layout was found.
        """
        ...

    def update(self, before: Step, now: Step, active: Bool, solved: Bool) -> None:
        """Completes the states of the active copies after a physics step, and scores the step.

        Args:
            before: the previous step; only read.
            now: this step. Its `times`, `events`, `layouts`, `seeds`, and the positions, velocities
                and headings in `states` are final; targets and extras are still those of the
                previous step and have to be updated here. The first columns of `reward_terms` are
                written: the values of `terms`, unweighted. The terms that all tasks share (success,
                contacts, proximity) follow; they, and the rewards, are not the task's to write.
            active: which copies took the step, [E].
            solved: written: whether the task is solved after this step, [E].
        """
        ...

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        """Writes the task's features of every robot in the active copies.

        Args:
            states: [E, S].
            layouts: [E, M, 8].
            active: which copies to write, [E].
            out: written, in the order of `features` and in the world's frame, [E, N, F].
        """
        ...

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        """Returns one value for each name in `metrics`."""
        ...


@runtime_checkable
class VecEnv(Protocol):
    """E copies of one task that are stepped together.

    A copy that has ended stays as it is until the caller resets it.
    """

    spec: TaskSpec
    task: Task
    n_copies: int
    features: tuple[Feature, ...]  # the meaning of each number in an observation, O
    observation_size: int
    action_size: int
    state_size: int

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts new episodes in some copies, by default in all of them.

        Args:
            seeds: one episode seed for each copy that is reset, [E] or [len(copies)].
            copies: indices of the copies to reset; the others keep their state.

        Returns:
            The step of all copies; rewards, flags and events of the reset copies are zero.

        Raises:
            SpawnError: no collision-free layout was found.
        """
        ...

    def step(self, actions: Float | Double) -> Step:
        """Advances every copy that has not ended by one control step.

        Args:
            actions: joint actions in [-1, 1], [E, N, A].

        Raises:
            SchemaError: `actions` has the wrong shape or dtype, or is not finite.
        """
        ...

    def close(self) -> None:
        """Gives up what it holds beside memory."""
        ...


@runtime_checkable
class Policy(Protocol):
    """Chooses joint actions from observations, or from states if `uses_state`."""

    @property
    def uses_state(self) -> bool:
        """Whether it reads `Step.states`, and so knows more than the robots observe."""
        ...

    def reset(self, step: Step, copies: Int) -> None:
        """Clears the policy's memory of `copies`, in which new episodes have begun."""
        ...

    def act(self, step: Step) -> Float:
        """Returns joint actions in [-1, 1], float32 [E, N, A].

        Randomness must be a function of `step.seeds` and `step.times` only, so that an episode does
        not depend on the batch it runs in.
        """
        ...

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns the log-probability of each robot's action, float32 [E, N].

        The convention is that of `action_probabilities`. The function is pure, elementwise over
        copies, and finite for the actions that `act` returned on this step.

        Args:
            step: the step on which the actions were chosen.
            actions: joint actions in [-1, 1], float32 [E, N, A].

        Raises:
            SchemaError: the policy has a memory and `step` is not the last one it acted on; a
                policy without memory accepts any step and any actions.
        """
        ...


def check_acts(policy: object, *members: str) -> None:
    """Refuses what is no policy where one acts.

    Args:
        policy: that is about to act.
        members: of the protocol `Policy` that are needed.

    Raises:
        SchemaError: it lacks one of them.
    """
    missing = [name for name in members if not hasattr(policy, name)]
    if missing:
        raise SchemaError(
            f"the policy is {policy!r:.100}, which has no {' and no '.join(missing)}, expected a "
            "policy (swarmdata.Policy). Wrap a function in swarmdata.FunctionPolicy; "
            "swarmdata.make_policy opens a name or a run folder."
        )


@runtime_checkable
class OnlineAlgorithm(Protocol):
    """Learns K policies, one per seed, by acting in environments of its own.

    Built as `Kind(env, seeds, config, folder)` from K * E copies of a task, the seeds [K], a
    `Config`, and a folder, which it makes, for data that is too large for a checkpoint.
    `Kind.Config` is a frozen dataclass with the fields `n_steps` and `n_copies`; `Kind.LOSSES`
    names the losses that `update` returns.
    """

    @property
    def frames(self) -> int:
        """Number of joint steps that each seed has taken."""
        ...

    def prepare(self) -> bool:
        """Prepares a new run before its first update; returns whether that took long.

        If so, the caller writes a checkpoint, after which new episodes have to begin.
        """
        ...

    def update(self) -> dict[str, Any]:
        """Acts and learns for one round; returns the losses, each [K], NaN where undefined."""
        ...

    def policy(self, index: int) -> Policy:
        """Returns the current greedy policy of seed number `index`.

        A run keeps it in a file, so it is of a class of `swarmdata.learn.policies`, or a dataclass
        of tensors, numbers, texts and lists of these that `Kind.POLICIES` names.
        """
        ...

    def restart_worlds(self) -> None:
        """Begins new episodes in all copies, as `load_state_dict` does."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Returns copies of all tensors that the run needs, except the running episodes."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` returned, so that the run continues bit for bit."""
        ...


@runtime_checkable
class Algorithm(Protocol):
    """Updates K policies, one per seed, from batches of recorded data.

    `Kind.FIELDS` may name the fields of `Batch` that `update` reads: the others, but for `mask`,
    `alive`, `next_alive` and `agent_terminations`, are not gathered and are None. A class that does
    not name them itself gets all.
    """

    def update(self, batch: Batch) -> dict[str, Any]:
        """Takes a gradient step on a batch of tensors [K, B, ...]; returns the losses, each [K]."""
        ...

    def policy(self, index: int) -> Policy:
        """Returns the current greedy policy of seed number `index`."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Returns all tensors that training needs to continue bit for bit, by name, as copies."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        ...


def fields_of(kind: type) -> frozenset[str] | None:
    """Returns the fields of a batch that an algorithm itself declares; None: it gets all.

    Raises:
        UnknownNameError: a batch has no such field.
    """
    if (declared := vars(kind).get("FIELDS")) is None:
        return None
    known = [field.name for field in fields(Batch)]
    for name in declared:
        if name not in known:
            raise UnknownNameError(f"field of a batch in {kind.__name__}.FIELDS", name, known)
    return frozenset(declared)
