"""FunctionPolicy turns any function of observations into a policy to evaluate and record."""

from collections.abc import Callable
from types import NoneType
from typing import Any, Literal

import numpy as np

from swarmdata.errors import SchemaError, SpecError, check_type
from swarmdata.perception.frames import Frame, find_frame, in_world
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.specs.action_scaling import action_scale
from swarmdata.specs.origins import SPEC_KINDS, Spec
from swarmdata.types import Double, Float, Int, Step

Function = Callable[[Float], Any]
"""Maps observations, float32 [E, N, O], to actions, [E, N, A]: a NumPy array, or anything that
NumPy reads without a copy, such as a CPU tensor without gradient."""


class FunctionPolicy:
    """A deterministic policy without memory, of any framework; actions are clipped to their bounds.

        policy = FunctionPolicy(lambda observations: network(torch.from_numpy(observations)))

    Policies of this library act in [-1, 1], as the batches of samplers do, while episodes of
    recorded environments and of logs are in the environment's units. A function that learned from
    episodes says so by `units=dataset.spec`, and acts in the environment as it would without this
    library.

    Episodes do not depend on the batch only if the function returns the same actions for a copy in
    any batch, as products in float64 do, but not in float32, whose last bits differ.

    Args:
        function: maps observations to actions.
        frame: in which the function sees and acts, such as `setup.sizes.frame` of an offline
            algorithm, whose batches are in it; None: the world's, as recorded.
        units: in which the function acts. `dataset.spec`: as that dataset's episodes,
            `transitions()` and exports, in the environment's units or as choices. "unit": in
            [-1, 1], as batches of a sampler. None: likewise, for the tasks of this library, whose
            actions are always in [-1, 1]; in other environments, such a function is refused.

    Raises:
        SchemaError: an argument is of another type, or the continuous actions of `units` are
            without bounds.
    """

    uses_state = False

    def __init__(
        self,
        function: Function,
        *,
        frame: Frame | None = None,
        units: Spec | Literal["unit"] | None = None,
    ) -> None:
        if not callable(function):
            raise SchemaError(f"the policy is {function!r:.100}, expected a function")
        advice = "Pass frame=swarmdata.frame_of(dataset.spec, 'target'), or leave it out."
        check_type("frame", frame, (Frame, NoneType), "a Frame or None", advice)
        self._function, self._frame, self.units = function, frame, units
        self._scale, self._chooses = None, False
        if units is not None and units != "unit":
            advice = "Pass units=dataset.spec."
            check_type("units", units, tuple(SPEC_KINDS.values()), "a spec or 'unit'", advice)
            self._scale = action_scale(units) if units.action_kind == "continuous" else None
            self._chooses = units.action_kind == "choices"
        self._last = LastMeans[Double]()

    def reset(self, step: Step, copies: Int) -> None:
        """Does nothing: the policy has no memory."""

    def act(self, step: Step) -> Float:
        """Returns the function's actions, [E, N, A]."""
        means = self._means(step.observations)
        self._last.keep(step, means)
        return means.astype(np.float32)

    def actions(self, observations: Float) -> Float:
        """Returns the function's actions, [E, N, A], for observations [E, N, O]."""
        return self._means(observations).astype(np.float32)

    def log_probs(self, step: Step, actions: Float) -> Float:
        """Returns 0 for the function's own actions, -inf for others, [E, N]."""
        means = self._last.recall(step)  # right after `act`: the function need not run again
        if means is None:
            means = self._means(step.observations)
        return noisy_log_probs(means, actions, 0.0)

    def _means(self, observations: Float) -> Double:
        """Returns the function's actions as policies act, rounded to float32, [E, N, A]."""
        n_copies, n_agents = observations.shape[:2]
        seen = observations
        if self._frame is not None:
            seen = self._frame.inputs(seen)
        actions = np.asarray(self._function(seen), dtype=np.float64)
        size = actions.shape[-1:] if self._scale is None else self._scale.middle.shape[1:]
        if actions.shape != (n_copies, n_agents, *size):
            raise SchemaError(
                f"the policy's function returned shape {actions.shape} for observations "
                f"{seen.shape}, expected ({n_copies}, {n_agents}, "
                f"{'A' if self._scale is None else size[0]}): one action of each robot in each copy"
            )
        if not np.isfinite(actions).all():
            raise SchemaError(
                "the policy's function returned actions that are not finite; check its parameters"
            )
        if self._scale is not None:
            actions = self._scale.relative(actions)
        inside = actions if self._chooses else actions.clip(-1.0, 1.0)
        turned = in_world(self._frame, observations, inside)
        return turned.astype(np.float32).astype(np.float64)


def frame_of(spec: Spec, anchor: str = "auto") -> Frame | None:
    """Returns the frame in which robots see and act; None for the world's, as data are recorded.

        >>> frame = swarmdata.frame_of(dataset.spec, "reference.heading")
        >>> batch = next(dataset.sampler(256, seed=0)).in_frame(frame)
        >>> policy = swarmdata.FunctionPolicy(act, frame=frame)

    `dataset.frame` is the default one.

    Args:
        spec: of a dataset. Recorded environments have only the world frame.
        anchor: as `frames.find_frame` takes it.

    Raises:
        SpecError: the task's observations have no such anchor.
        SchemaError: it is no spec.
    """
    check_type("the spec", spec, tuple(SPEC_KINDS.values()), "a spec", "Pass dataset.spec.")
    if spec.world is None:
        if anchor not in ("auto", "world"):
            raise SpecError(
                f"frame {anchor!r}: the meaning of a recorded environment's features is unknown. "
                "Use frame 'world'."
            )
        return None
    return find_frame(features_of(make_task(spec.world)), anchor, spec.world.robots)
