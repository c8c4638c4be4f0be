"""The data types that environments, policies, datasets and results exchange.

Axis letters, always in this order: E copies of a task or B batch, T time, N agents, then features:
O observation, S state, A action, P values of a message. M is the number of obstacles in a layout.
Without a communication channel, P and the sender axis of `delivered` and `ages` are 0. Fields that
a recording of another environment lacks are empty: `events` [T, N, 0], `log_probs` [T, 0], layouts
[0, 8], states [T+1, 0].
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swarmdata.errors import MissingExtraError, SchemaError, SpecError

if TYPE_CHECKING:
    import torch

    from swarmdata.perception.frames import Frame

Float = NDArray[np.float32]
Double = NDArray[np.float64]
Bool = NDArray[np.bool_]
Int = NDArray[np.int64]
Seeds = NDArray[np.uint64]
Counts = NDArray[np.uint8]
FloatOrByte = NDArray[np.float32 | np.uint8]
"""Observations and states: uint8 where images of bytes were recorded, else float32."""


REPR_CHARACTERS = 300
"""Most characters of the `repr` of a public object, so that a notebook shows one in a few lines."""


def shortened(text: str) -> str:
    """Returns a `repr` of at most `REPR_CHARACTERS`: of a longer one, its beginning and end."""
    if len(text) <= REPR_CHARACTERS:
        return text
    n_last = REPR_CHARACTERS // 4
    return f"{text[: REPR_CHARACTERS - n_last - 3]}...{text[-n_last:]}"


class Column(NamedTuple):
    """The meaning of one number in the rows of an array."""

    name: str
    meaning: str
    unit: str = ""  # empty for codes, counts, fractions and components of unit vectors
    low: float | None = None  # lower bound; None: unbounded
    high: float | None = None  # upper bound; None: unbounded
    frame: str = ""  # "world" or "body"; empty where none applies


class Term(NamedTuple):
    """One term of a robot's reward: `sign` times `weight` times the value in the step."""

    name: str  # also that of its weight in `spec.rules.rewards`
    weight: float  # at least 0
    sign: Literal[1, -1]  # 1: a reward, -1: a cost
    value: str  # formula of what `reward_terms` holds; [x] is 1 where x holds, else 0
    meaning: str  # of the symbols in the formula

    @property
    def formula(self) -> str:
        """The term as it enters the reward, in terms of `weight`."""
        return f"{'-' if self.sign < 0 else ''}weight * {self.value}"

    @property
    def signed_weight(self) -> float:
        """What the value is multiplied by."""
        return self.sign * self.weight


PROXIMITY_RANGE = 0.1
"""Gap (m) to a robot, obstacle or wall below which the reward's proximity term is positive."""

SEPARATION_GAP = 0.01
"""A contact ends when the gap exceeds this (m), so that jitter at rest is one contact."""

_OVERLAPPED = "after at least one physics step of this step, the robot overlapped"
_ONSET_RULE = (
    "began in this step: an overlap (gap <= 0 m after a physics step) of two that were not in "
    f"contact. A contact, once begun, lasts until their gap exceeds {SEPARATION_GAP:g} m"
)

_ROBOT_ONSETS = (
    f"contacts of the robot with other robots that {_ONSET_RULE}. Each is counted in the rows of "
    "both robots"
)
_OBSTACLE_ONSETS = (
    f"contacts of the robot with obstacles and walls, each for itself, that {_ONSET_RULE}"
)

EVENT_COLUMNS = (
    Column("robot_contact", f"1 if, {_OVERLAPPED} another robot, else 0", low=0, high=1),
    Column("obstacle_contact", f"1 if, {_OVERLAPPED} an obstacle or wall, else 0", low=0, high=1),
    Column("robot_onsets", _ROBOT_ONSETS, low=0, high=255),
    Column("obstacle_onsets", _OBSTACLE_ONSETS, low=0, high=255),
)
"""Columns of `events`. A contact that lasts without overlap shows in none of them, and a step can
have overlap without an onset."""

EVENTS = tuple(column.name for column in EVENT_COLUMNS)

NEVER_RECEIVED = 255
"""In `ages`: nothing was ever received. Messages older than 254 steps count as 254."""

TASK_END_REASONS = ("success", "failure", "horizon")
"""Why an episode of a swarmdata task ended, by code: two terminations, then the truncation."""

END_REASONS = (*TASK_END_REASONS, "ended")
"""Why any episode ended. `ended`: a recorded environment does not say whether it was solved."""


@dataclass(frozen=True, slots=True)
class Metric:
    """The meaning of one per-episode number."""

    label: str
    unit: str  # empty for counts, fractions and returns
    better: Literal["higher", "lower", "neither"]
    meaning: str


class Step(NamedTuple):
    """The result of one joint action, or of a reset, in all copies of a task.

    The caller may keep the arrays: the environment never writes to them again. A copy that has
    ended stays as it is, with zero rewards and terms, until it is reset.
    """

    observations: Float  # [E, N, O]
    states: Float  # [E, S]
    rewards: Float  # [E, N]
    reward_terms: Float  # [E, N, R] unweighted, columns `components.reward_terms`; R may be 0
    terminations: Bool  # [E] the task ended, by success or by a failure that the spec defines
    truncations: Bool  # [E] the horizon cut the episode
    successes: Bool  # [E] the task was solved in this step (implies termination)
    events: Counts  # [E, N, 4] safety events of this step, columns `EVENTS`
    seeds: Seeds  # [E] seed of the episode that runs in each copy
    times: Int  # [E] control steps taken since that episode's reset
    layouts: Float  # [E, M, 8] obstacles of that episode, columns `geometry.OBSTACLE`
    sent: Float  # [E, N, P] message that each robot sent in this step
    delivered: Bool  # [E, N, N] whether a message of sender (last axis) arrived in this step
    ages: Counts  # [E, N, N] age of the newest message of a sender, steps, or NEVER_RECEIVED

    def __repr__(self) -> str:
        """Returns the shapes instead of the values."""
        return shortened(f"Step({_shapes(self._asdict())})")

    @property
    def ended(self) -> Bool:
        """Whether each copy has ended and needs a reset, [E]."""
        return self.terminations | self.truncations


STATE_FIELDS = ("observations", "states", "sent", "delivered", "ages")
"""Fields of an episode that have a row for each state, T + 1."""

STEP_FIELDS = ("actions", "log_probs", "rewards", "terminations", "truncations", "events")
"""Fields of an episode that have a row for each joint action, T."""

OPTIONAL_STATE_FIELDS = ("alive", "action_masks")
"""More fields with T + 1 rows, in recordings where agents leave or choices are forbidden."""

OPTIONAL_STEP_FIELDS = ("reward_terms", "agent_terminations", "agent_truncations")
"""More fields with T rows: of our tasks, and of recordings where agents leave."""


def _shapes(arrays: Mapping[str, Any]) -> str:
    """Names and shapes of those that are arrays or tensors."""
    shaped = {name: array.shape for name, array in arrays.items() if hasattr(array, "shape")}
    return ", ".join(f"{name}={tuple(shape)}" for name, shape in shaped.items())


def copy_step(step: Step, copies: "slice | Int" = slice(None)) -> Step:
    """Returns a deep copy of a step, for all copies of the task or for those selected."""
    return Step._make(np.array(array[copies]) for array in step)


def no_messages(*shape: int) -> dict[str, Any]:
    """The fields `sent`, `delivered`, `ages` without communication; leading axes (..., N)."""
    return {
        "sent": np.zeros((*shape, 0), dtype=np.float32),
        "delivered": np.zeros((*shape, 0), dtype=np.bool_),
        "ages": np.zeros((*shape, 0), dtype=np.uint8),
    }


def blank_step(observations: Float, states: Float, **changes: Any) -> Step:
    """A step of robots that do not communicate, in which nothing but `changes` has happened."""
    e, n = observations.shape[:2]
    flags = {name: np.zeros(e, np.bool_) for name in ("terminations", "truncations", "successes")}
    nothing: dict[str, Any] = {
        "rewards": np.zeros((e, n), np.float32),
        "reward_terms": np.zeros((e, n, 0), np.float32),
        "events": np.zeros((e, n, len(EVENTS)), np.uint8),
        "seeds": np.zeros(e, np.uint64),
        "times": np.zeros(e, np.int64),
        "layouts": np.zeros((e, 0, 8), np.float32),
    }
    fields = {**nothing, **flags, **no_messages(e, n), **changes}
    return Step(observations=observations, states=states, **fields)


@dataclass(frozen=True, slots=True, eq=False)
class Episode:
    """One finished run of a task, time first.

    The fields in `STATE_FIELDS` have one row more than `actions`: the last row is the state after
    the last action, which bootstrapping at a truncation needs.
    """

    observations: Float  # [T+1, N, O]; uint8 of recorded images
    states: Float  # [T+1, S]; uint8 of recorded images
    actions: Float  # [T, N, A]
    log_probs: Float  # [T, N] of each robot's action, as in `rollouts.action_probabilities`
    rewards: Float  # [T, N]
    terminations: Bool  # [T]
    truncations: Bool  # [T]
    events: Counts  # [T, N, 4]
    sent: Float  # [T+1, N, P]
    delivered: Bool  # [T+1, N, N]
    ages: Counts  # [T+1, N, N]
    layout: Float  # [M, 8]
    seed: int
    policy: int  # index into the recipe's policies
    end_reason: int  # index into END_REASONS
    reward_terms: Float | None = None  # [T, N, R] unweighted; None if the rewards have no terms
    alive: Bool | None = None  # [T+1, N] agents that still act; None if agents cannot leave
    action_masks: Bool | None = None  # [T+1, N, C] allowed choices; None if all are allowed
    agent_terminations: Bool | None = None  # [T, N] None if agents cannot leave
    agent_truncations: Bool | None = None  # [T, N] None if agents cannot leave

    def __post_init__(self) -> None:
        """Checks that all time axes have the same length."""
        steps = len(self)
        for name in (*STATE_FIELDS, *STEP_FIELDS, *self.optional):
            rows = len(getattr(self, name))
            expected = steps + (name in STATE_FIELDS or name in OPTIONAL_STATE_FIELDS)
            if rows != expected:
                raise SchemaError(
                    f"episode field {name!r} has {rows} rows, expected {expected} "
                    f"(actions has {steps}). Pass the state reached by the last action as well."
                )

    @property
    def optional(self) -> tuple[str, ...]:
        """Names of the optional fields that are not None."""
        names = (*OPTIONAL_STATE_FIELDS, *OPTIONAL_STEP_FIELDS)
        return tuple(name for name in names if getattr(self, name) is not None)

    def __len__(self) -> int:
        """Number of joint steps, T."""
        return len(self.actions)

    def __repr__(self) -> str:
        """Returns the shapes instead of the values."""
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        end = f"seed={self.seed}, end_reason={self.end_reason} ({END_REASONS[self.end_reason]})"
        return shortened(f"Episode({_shapes(arrays)}, {end})")

    @property
    def success(self) -> bool:
        """Whether the episode ended because the task was solved."""
        return END_REASONS[self.end_reason] == "success"

    @property
    def team_return(self) -> float:
        """The sum over time, without discount, of the mean reward over agents."""
        return float(self.rewards.mean(axis=1, dtype=np.float64).sum())


Wanted = Collection[str] | None
"""Fields of a batch to read besides `mask`, which each has; the others are None. None: all."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Batch:
    """Transitions (L = 1, time axis dropped) or fixed-length sequences, batch first.

    `mask` is False on padding. A termination stops bootstrapping, a truncation does not.

    `next_actions` are the actions of the next step of the same episode, and zero where the episode
    has ended by either flag. They are None where they are not known, as in online replay.

    `log_probs` are those of the stored actions under the policies that chose them
    (`rollouts.action_probabilities`), even if `actions` are scaled or rotated into another frame,
    and zero on padding. They are None where they were not recorded, as in online replay and in most
    recordings of other environments.

    `episodes` are the positions of the transitions' episodes in the sampled subset, and zero on
    padding. They are None in online replay.

    `costs` are those of `numerics.event_costs`, and zero on padding. They are None in online replay
    and in recordings without events.

    `alive` says which agents act, `next_alive` which ones act in the next step, and
    `agent_terminations` which ones leave with this step because their task ended. Rows of agents
    that do not act have actions and rewards of 0. All are False on padding, and None where agents
    cannot leave.
    """

    observations: Any  # [B, N, O] or [B, L, N, O]; uint8 of recorded images, as states may be
    actions: Any  # [B, N, A] or [B, L, N, A]
    rewards: Any  # [B, N] or [B, L, N]
    next_observations: Any  # as observations
    states: Any  # [B, S] or [B, L, S]
    next_states: Any  # as states
    terminations: Any  # [B] or [B, L]
    truncations: Any  # [B] or [B, L]
    mask: Any  # [B] or [B, L]
    next_actions: Any = None  # as actions
    log_probs: Any = None  # as rewards
    episodes: Any = None  # as mask
    costs: Any = None  # [B, N, C] or [B, L, N, C]
    alive: Any = None  # as rewards
    agent_terminations: Any = None  # as rewards
    next_alive: Any = None  # as rewards

    def __len__(self) -> int:
        """Batch size, B."""
        return len(self.mask)

    def __repr__(self) -> str:
        """Returns the shapes instead of the values, on one line."""
        return shortened(f"Batch({_shapes({f.name: getattr(self, f.name) for f in fields(self)})})")

    def in_frame(self, frame: "Frame | None") -> "Batch":
        """Returns the batch as robots see and act in `frame`; states and rewards stay.

        Actions whose first two components turn are first scaled down to a norm of 1 where it is
        more, up to 1.414, because the worlds do so before they move a robot.

        Args:
            frame: of observations and actions, such as `dataset.frame`; None: the world's, in which
                data are recorded.
        """
        if isinstance(frame, str):
            raise SchemaError(
                f"frame is {frame!r:.100}, expected a Frame or None. Pass "
                "swarmdata.frame_of(dataset.spec, anchor)."
            )
        return self if frame is None else frame.turned(self)

    def to_torch(self, device: "torch.device | str" = "cpu") -> "Batch":
        """Returns the batch as tensors on `device`; on the CPU they share the arrays' memory.

        Raises:
            MissingExtraError: torch is not installed.
            SpecError: torch has no such device here.
        """
        try:
            import torch  # noqa: PLC0415  (torch is an extra)
        except ImportError as error:
            raise MissingExtraError("torch", "torch", "Batch.to_torch") from error
        check_device(device)
        arrays = {f.name: getattr(self, f.name) for f in fields(self)}
        return Batch(
            **{
                name: None if array is None else torch.from_numpy(array).to(device)
                for name, array in arrays.items()
            }
        )


def check_device(device: "torch.device | str") -> None:
    """Refuses a device that torch does not have here, by a SpecError, before anything is loaded."""
    import torch  # noqa: PLC0415  (torch is an extra)

    try:
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # whichever torch raises, by its build
        raise SpecError(
            f"torch has no device {str(device)!r} here, expected cpu, or cuda with a GPU and a "
            "torch that was built for it"
        ) from error


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class EvalResult:
    """Per-episode metrics of one policy, from which every figure and table is computed.

    `metrics` maps the name of each of the task's metrics to one float64 value per episode. An
    undefined value, such as the time to goal of a failed episode, is NaN.
    """

    policy: str
    task: str
    spec_hash: str
    seeds: Seeds  # [n_episodes]
    metrics: Mapping[str, Double]  # name -> [n_episodes]

    def __repr__(self) -> str:
        """Returns means instead of the values, on one line."""
        means = {k: self.metrics[k].mean() for k in ("return", "success") if k in self.metrics}
        shown = ", ".join(f"mean {name} {mean:.4g}" for name, mean in means.items())
        return shortened(
            f"EvalResult({self.policy} in {self.task}: {len(self.seeds)} episodes, {shown})"
        )
