"""What a world, a policy and an algorithm must be able to do. Nothing else is assumed of them."""

from collections.abc import Mapping
from typing import Any, ClassVar, Protocol, runtime_checkable

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
    """One problem with the constants of one spec: pure functions over arrays, and no physics.

    Built as `Task(spec)`. A state row is described in `states`; what follows the robots and the
    movable bodies, `extras` numbers, is the task's own. An episode's states and layout, its seed
    and its times determine all that these functions write, so it can be computed again from a
    dataset.
    """

    spec: TaskSpec
    kinds: Int  # [M] shape code of each row of a layout, the same in every episode
    movables: tuple[Payload, ...]  # bodies that robots can push
    extras: tuple[Column, ...]  # the task's own columns of a state
    features: tuple[Feature, ...]  # what the task adds to every robot's observation
    terms: tuple[Term, ...]  # of the task's own reward; `registry.reward_terms` has all
    solved: str  # when the task is, a clause
    metrics: ClassVar[Mapping[str, Metric]]  # what the task adds to `metrics.EPISODE_METRICS`

    def spawn(self, seeds: Seeds, copies: Int, layouts: Float, states: Float) -> None:
        """Draws the episodes `seeds` into the rows `copies` of layouts [E, M, 8], states [E, S].

        Raises:
            SpawnError: no layout could be drawn.
        """
        ...

    def update(self, before: Step, now: Step, active: Bool, rewards: Double, solved: Bool) -> None:
        """Completes the states of the active copies and scores the step.

        Args:
            before: the step before; only read.
            now: positions, velocities and headings in `states`, `times`, `events`, `layouts` and
                `seeds` are those of this step; targets and extras still those of the step before,
                and to be written.
            active: copies that took the step, [E].
            rewards: written, the task's own reward of each robot, without what every task shares
                (success, contacts, proximity), [E, N].
            solved: written, whether the task is solved in this step, [E].
        """
        ...

    def write_features(self, states: Float, layouts: Float, active: Bool, out: Float) -> None:
        """Writes `features` of every robot of the active copies in the world's frame, [E, N, F]."""
        ...

    def episode_metrics(self, episode: Episode) -> dict[str, float]:
        """One value per name of `metrics`."""
        ...


@runtime_checkable
class VecEnv(Protocol):
    """E copies of one task, stepped together; resetting is the caller's visible decision."""

    spec: TaskSpec
    task: Task
    n_copies: int
    features: tuple[Feature, ...]  # what each number of an observation is, O
    observation_size: int
    action_size: int
    state_size: int

    def reset(self, seeds: Seeds, copies: Int | None = None) -> Step:
        """Starts the episodes `seeds` in the copies listed (all by default).

        Args:
            seeds: one episode seed per reset copy, [E] or [len(copies)].
            copies: indices of the copies to reset; the others keep their state.

        Returns:
            The step of all copies; rewards, flags and events of the reset copies are zero.

        Raises:
            SpawnError: no layout could be drawn.
        """
        ...

    def step(self, actions: Float | Double) -> Step:
        """Advances every copy that has not ended by one control step.

        Args:
            actions: joint actions in [-1, 1], [E, N, A].

        Raises:
            SchemaError: wrong shape, or an action that is not finite.
        """
        ...


@runtime_checkable
class Policy(Protocol):
    """Chooses joint actions from what the robots see, or from states if `uses_state`."""

    @property
    def uses_state(self) -> bool:
        """Whether it reads `Step.states`, and so knows more than the robots."""
        ...

    def reset(self, step: Step, copies: Int) -> None:
        """Forgets what it knew about `copies`, in which new episodes have begun."""
        ...

    def act(self, step: Step) -> Float:
        """Returns joint actions in [-1, 1], float32 [E, N, A].

        Randomness must be a function of `step.seeds` and `step.times` only, so that an episode is
        the same in any batch.
        """
        ...

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns the log-probability of each robot's action, float32 [E, N], as `density` says.

        Pure, elementwise over copies, and finite for what `act` returned on this step. A policy
        with memory knows it of the step that it acted on last only, and raises SchemaError for
        any other; the others know it of every step and action.

        Args:
            step: what the actions answer.
            actions: joint actions in [-1, 1], float32 [E, N, A].
        """
        ...


@runtime_checkable
class OnlineAlgorithm(Protocol):
    """Learns K policies, one per seed, in worlds of its own.

    Built as `Kind(env, seeds, config, folder)`: K E copies of a task, the seeds [K], a `Config`,
    and a folder for what is too large for a checkpoint. `Kind.Config` is a frozen dataclass with
    `n_steps` and `n_copies`, `Kind.LOSSES` names what `update` returns.
    """

    @property
    def frames(self) -> int:
        """Joint steps that each seed has taken."""
        ...

    def prepare(self) -> bool:
        """Does what comes before the first update of a new run, such as cloning a teacher.

        Returns:
            Whether it took long enough for a checkpoint, after which new episodes have to begin.
        """
        ...

    def update(self) -> dict[str, Any]:
        """One round of acting and learning; returns losses, each [K], NaN where none is defined."""
        ...

    def policy(self, index: int) -> Policy:
        """The greedy policy of seed number `index`, as it is now."""
        ...

    def restart_worlds(self) -> None:
        """Begins new episodes everywhere, as loading a state does."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Everything but the running episodes, as tensors; copies."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` returned, to continue bit for bit."""
        ...


@runtime_checkable
class Algorithm(Protocol):
    """Updates K policies, one per seed, from batches of recorded data."""

    def update(self, batch: Batch) -> dict[str, Any]:
        """One gradient step on a batch of tensors [K, B, ...]; returns the losses, each [K]."""
        ...

    def policy(self, index: int) -> Policy:
        """The greedy policy of seed number `index`."""
        ...

    def state_dict(self) -> dict[str, Any]:
        """Everything needed to continue bit for bit, as tensors."""
        ...

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Restores what `state_dict` returned."""
        ...
