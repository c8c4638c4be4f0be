"""The scripted controller of `formation`: robots follow their slots, around obstacles.

Each robot aims at its slot and adds the slot's velocity, so that it does not lag behind. Where the
slot is blocked, it drives to the next free position on the slot's path, and awaits it there.
"""

from typing import NamedTuple, Self

import numpy as np

from swarmdata.behavior_policies.scripted import Scripted
from swarmdata.envs.formation.formation import Formation
from swarmdata.envs.formation.reference_path import write_pose
from swarmdata.envs.formation.slots import slot_velocity
from swarmdata.numerics.geometry import clearance
from swarmdata.runtime.kernels import kernel
from swarmdata.specs.state_layout import N_COLUMNS, TX, TY
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Double, Float, Int, Step

FREE_SLOT_GAP = 0.02  # m of gap of a free slot: more than `avoidance` keeps from surfaces
LOOK_INTERVAL = 0.2  # seconds between the positions on a slot's path that are checked
N_LOOKS = 40  # positions that are checked: 8 s, in which slots have passed every usual obstacle


class SlotPaths(NamedTuple):
    """Constants of the robots and of the path that their slots follow."""

    radii: Double  # [N] m
    half: Double  # [2] m, half width and half height of the arena
    first: int  # index of the path's control points in a state
    segments_per_step: float  # of the path, in a control step
    segments_per_look: float  # in `LOOK_INTERVAL` seconds

    @classmethod
    def of(cls, task: Formation) -> Self:
        spec, columns = task.spec, [column.name for column in task.extras]
        return cls(
            radii=np.array([robot.radius for robot in spec.robots]),
            half=np.array([spec.arena.width / 2.0, spec.arena.height / 2.0]),
            first=N_COLUMNS * spec.n_agents + columns.index("control_0_x"),
            segments_per_step=spec.control_dt * task.segment_rate,
            segments_per_look=LOOK_INTERVAL * task.segment_rate,
        )


@kernel
def next_free_position(
    state: Float,  # [S]
    slot: tuple[float, float],  # its position in the reference's frame, m
    segment: float,  # of the path, from its start until now
    paths: SlotPaths,  # constants of robots and path
    need: float,  # clearance of a free position, m
    layout: Float,  # [M, 8] obstacles
) -> tuple[bool, float, float]:
    """Whether a slot's path has a free position ahead, and the first one."""
    pose, first = np.empty(4), paths.first
    end = float((state.shape[0] - first) // 2 - 3)
    for look in range(1, N_LOOKS + 1):
        s = segment + look * paths.segments_per_look
        if s > end:
            break
        write_pose(state, first, s, pose, 0)
        x = pose[0] + pose[2] * slot[0] - pose[3] * slot[1]
        y = pose[1] + pose[3] * slot[0] + pose[2] * slot[1]
        if clearance(x, y, layout, paths.half) >= need:
            return True, x, y
    return False, 0.0, 0.0


@kernel
def aim_at_slots(
    states: Float, times: Int, layouts: Float, paths: SlotPaths, targets: Double, drifts: Double
) -> None:
    """Writes the robots' targets, m, and the velocities of these, m/s, both [E, N, 2].

    `states` are [E, S], `times` the control steps taken, [E], and `layouts` [E, M, 8].
    """
    n = paths.radii.shape[0]
    at = N_COLUMNS * n
    for b in range(states.shape[0]):
        state, layout = states[b], layouts[b]
        ux, uy = float(state[at + 4]), float(state[at + 5])
        segment = times[b] * paths.segments_per_step
        for i in range(n):
            x, y = float(state[N_COLUMNS * i + TX]), float(state[N_COLUMNS * i + TY])
            targets[b, i, 0], targets[b, i, 1] = x, y
            drifts[b, i, 0], drifts[b, i, 1] = slot_velocity(state, n, i)
            need = paths.radii[i] + FREE_SLOT_GAP
            if clearance(x, y, layout, paths.half) >= need:
                continue
            dx, dy = x - float(state[at]), y - float(state[at + 1])
            slot = (dx * ux + dy * uy, dy * ux - dx * uy)
            is_free, x, y = next_free_position(state, slot, segment, paths, need, layout)
            if is_free:
                targets[b, i, 0], targets[b, i, 1] = x, y
                drifts[b, i, 0], drifts[b, i, 1] = 0.0, 0.0


class FormationController(Scripted):
    """Drives every robot to its slot, or to the next free position on the slot's path.

    It knows the map, all robots and the whole path of the reference. It sends no messages.
    Arguments and errors are those of `Scripted`; a spec of another task is refused too.
    """

    def __init__(self, spec: TaskSpec, *, noise: float = 0.0) -> None:
        self._paths = SlotPaths.of(Formation(spec))
        super().__init__(spec, noise=noise)

    def commands(self, step: Step) -> Double:
        targets, drifts = np.empty((2, len(step.states), len(self._paths.radii), 2))
        aim_at_slots(step.states, step.times, step.layouts, self._paths, targets, drifts)
        return self._navigator.commands(step, targets, drifts)
