"""What a world, a policy and an algorithm must be able to do. Nothing else is assumed of them."""

from typing import Any, Protocol, runtime_checkable

from swarmdata.spec import TaskSpec
from swarmdata.types import Batch, Double, Float, Int, Seeds, Step


@runtime_checkable
class VecEnv(Protocol):
    """E copies of one task, stepped together; resetting is the caller's visible decision."""

    spec: TaskSpec
    n_copies: int
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

    uses_state: bool

    def reset(self, step: Step, copies: Int) -> None:
        """Forgets what it knew about `copies`, in which new episodes have begun."""
        ...

    def act(self, step: Step) -> Float:
        """Returns joint actions in [-1, 1], float32 [E, N, A].

        Randomness must be a function of `step.seeds` and `step.times` only, so that an episode is
        the same in any batch.
        """
        ...


@runtime_checkable
class Algorithm(Protocol):
    """Updates K policies, one per seed, from batches; online and offline share this."""

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
