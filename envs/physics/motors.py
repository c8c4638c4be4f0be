"""What is between a command and a robot's motors: a delay, and a lag of first order.

A command takes effect `command_delay` control steps late; until the first one arrives, robots are
told to stand still (0, 0). The motors' command u then follows the one that has arrived, c:

    u <- u + (1 - exp(-dt / lag)) (c - u)

the exact solution of lag du/dt = c - u over a step, with u = 0 at the start. It holds in every
simulator, since `dynamics.drive` takes u as the command.
"""

import numpy as np

from swarmdata.numerics.episode_draws import drawn_values
from swarmdata.numerics.exact_math import exp
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Bool, Double, Int, Seeds


@kernel
def _follow(
    active: Bool,  # [E]
    times: Int,  # [E] control steps taken, this one included
    delays: Int,  # [E, N] control steps
    shares: Double,  # [E, N] 1 - exp(-dt / lag)
    given: Double,  # [E, D + 1, N, 2] the last commands, a ring over time
    motors: Double,  # [E, N, 2] commands of the motors, read and written
    commands: Double,  # [E, N, 2] read and written
) -> None:
    """Replaces the commands of the active copies by those that reach the motors."""
    depth = given.shape[1]
    for b in range(commands.shape[0]):
        if not active[b]:
            continue
        for i in range(commands.shape[1]):
            sent = times[b] - delays[b, i]  # 1 in the first step
            for c in range(2):
                given[b, times[b] % depth, i, c] = commands[b, i, c]
                arrived = given[b, sent % depth, i, c] if sent > 0 else 0.0
                motors[b, i, c] += shares[b, i] * (arrived - motors[b, i, c])
                commands[b, i, c] = motors[b, i, c]


class Motors:
    """The motors of E teams."""

    def __init__(self, spec: TaskSpec, n_copies: int) -> None:
        n, self._spec = spec.n_agents, spec
        longest = int(max(spec.largest("command_delay")))
        self._delays: Int = np.zeros((n_copies, n), np.int64)
        self._shares: Double = np.zeros((n_copies, n))
        self._given: Double = np.zeros((n_copies, longest + 1, n, 2))
        self._motors: Double = np.zeros((n_copies, n, 2))

    @staticmethod
    def of(spec: TaskSpec, n_copies: int) -> "Motors | None":
        """The motors of a spec's robots; None if all of them follow commands at once."""
        has_any = any(map(any, (spec.largest("command_delay"), spec.largest("actuator_lag"))))
        return Motors(spec, n_copies) if has_any else None

    def reset(self, copies: Int, seeds: Seeds) -> None:
        """Stops the motors of some copies, [C], in which the episodes `seeds` begin, [C]."""
        robots, dt = self._spec.robots, self._spec.control_dt
        drawn = drawn_values(self._spec, seeds)
        delays = np.array([robot.command_delay for robot in robots], np.float64)
        lags = np.array([robot.actuator_lag for robot in robots])
        self._delays[copies] = drawn.get("command_delay", delays)
        lags = drawn.get("actuator_lag", lags)
        steps = np.divide(dt, lags, out=np.full_like(lags, np.inf), where=lags > 0.0)
        self._shares[copies] = 1.0 - exp(-steps)
        self._motors[copies] = 0.0

    def follow(self, active: Bool, times: Int, commands: Double) -> None:
        """Replaces commands [E, N, 2] by those that reach the motors, as `_follow` says."""
        _follow(
            active, times, self._delays, self._shares, self._given, self._motors, commands
        )  # fmt: skip
