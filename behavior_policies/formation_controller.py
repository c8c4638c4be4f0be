"""The scripted controller of `formation`: to the own slot, with its velocity, around obstacles.

Each robot aims at its slot and adds the slot's velocity to its own, so that it does not lag behind
(feed-forward). Where its slot is blocked, it looks along the slot's way, which it knows from the
reference's path, for the next free place, and drives there, around the obstacle, to be in the slot
when it comes out.

Float64 `+ - * /` and `sqrt` only, so that the bits are the same on every platform.
"""

import numpy as np

from swarmdata.behavior_policies.navigation.navigator import Navigator
from swarmdata.behavior_policies.noise import check_noise
from swarmdata.behavior_policies.scripted import actions_of
from swarmdata.envs.formation.formation import Formation
from swarmdata.envs.formation.reference_path import write_pose
from swarmdata.envs.formation.slots import slot_velocity
from swarmdata.numerics.geometry import clearance
from swarmdata.rollouts.action_probabilities import LastMeans, noisy_log_probs
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

MARGIN = 0.02
"""Metres of gap that a slot needs to be free: more than `avoidance` keeps from surfaces."""

LOOK = 0.2
"""Seconds between the places of a slot's way that are looked at."""

N_LOOKS = 40
"""Places that are looked at: 8 s, in which slots have passed every usual obstacle."""


@kernel
def next_free_place(
    state: Float,
    slot: tuple[float, float],
    first: int,
    segments: tuple[float, float],
    need: float,
    layout: Float,
    half: Double,
) -> tuple[bool, float, float]:
    """Returns whether a slot's way has a free place, and the first one.

    Args:
        state: [S].
        slot: its place in the reference's frame, m.
        first: where the path's control points begin in the state.
        segments: of the path, from its start until now, and in `LOOK` seconds.
        need: clearance of a free place, m.
        layout: [M, 8].
        half: half width and half height of the arena, m, [2].
    """
    pose = np.empty(4)
    end = float((state.shape[0] - first) // 2 - 3)
    for look in range(1, N_LOOKS + 1):
        s = segments[0] + look * segments[1]
        if s > end:
            break
        write_pose(state, first, s, pose, 0)
        x = pose[0] + pose[2] * slot[0] - pose[3] * slot[1]
        y = pose[1] + pose[3] * slot[0] + pose[2] * slot[1]
        if clearance(x, y, layout, half) >= need:
            return True, x, y
    return False, 0.0, 0.0


@kernel
def aim_at_slots(
    states: Float,
    times: Int,
    layouts: Float,
    body: tuple[Double, Double],
    path: tuple[int, float, float],
    targets: Double,
    drifts: Double,
) -> None:
    """Writes where the robots of all copies should be, and how fast these points move.

    Args:
        states: [E, S].
        times: control steps taken, [E].
        layouts: [E, M, 8].
        body: radii, m, [N]; half width and half height of the arena, m, [2].
        path: where the control points begin in a state; segments of the path in a control step and
            in `LOOK` seconds.
        targets: written, m, [E, N, 2].
        drifts: written, m/s, [E, N, 2].
    """
    radii, half = body
    n = radii.shape[0]
    at = N_COLUMNS * n
    for b in range(states.shape[0]):
        state, layout = states[b], layouts[b]
        ux, uy = float(state[at + 4]), float(state[at + 5])
        segments = (times[b] * path[1], path[2])
        for i in range(n):
            x, y = float(state[N_COLUMNS * i + TX]), float(state[N_COLUMNS * i + TY])
            targets[b, i, 0], targets[b, i, 1] = x, y
            drifts[b, i, 0], drifts[b, i, 1] = slot_velocity(state, n, i)
            need = radii[i] + MARGIN
            if clearance(x, y, layout, half) >= need:
                continue
            dx, dy = x - float(state[at]), y - float(state[at + 1])
            slot = (dx * ux + dy * uy, dy * ux - dx * uy)
            is_free, x, y = next_free_place(state, slot, path[0], segments, need, layout, half)
            if is_free:
                targets[b, i, 0], targets[b, i, 1] = x, y
                drifts[b, i, 0], drifts[b, i, 1] = 0.0, 0.0


class FormationScript:
    """Drives every robot to its slot, or to where its slot will be free next.

    It knows more than the robots see: the map (`step.layouts`), the positions and velocities of all
    robots and the whole path of the reference (`step.states`). It sends no messages.

    Args:
        spec: a spec of `formation`.
        noise: standard deviation of the Gaussian noise on each command.

    Raises:
        SpecError: the spec is another task's, or `noise` is not a standard deviation.
    """

    uses_state = True

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        task = Formation(spec)
        self._noise = check_noise(noise)
        self._last = LastMeans()
        self._action_size = spec.action_size
        self._navigator = Navigator(spec)
        radii = np.array([robot.radius for robot in spec.robots])
        half = np.array([spec.arena.width / 2.0, spec.arena.height / 2.0])
        self._body = (radii, half)
        points = N_COLUMNS * spec.n_agents + [column.name for column in task.extras].index(
            "control_0_x"
        )
        self._path = (points, spec.control_dt * task.segment_rate, LOOK * task.segment_rate)

    def reset(self, step: Step, copies: Int) -> None:
        """Maps the layouts of `copies`."""
        self._navigator.reset(step, copies)

    def act(self, step: Step) -> Float:
        targets, drifts = np.empty((2, len(step.states), len(self._body[0]), 2))
        aim_at_slots(step.states, step.times, step.layouts, self._body, self._path, targets, drifts)
        commands = self._navigator.commands(step, targets, drifts)
        self._last.keep(step, commands)
        return actions_of(commands, step, self._noise, self._action_size)

    def log_probs(self, step: Step, actions: Float) -> Float:
        return noisy_log_probs(self._last.require(step), actions, self._noise)
