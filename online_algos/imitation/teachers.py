"""Which teacher actors clone, and how it is kept from contacts."""

import inspect
from dataclasses import dataclass

from swarmdata.errors import SpecError
from swarmdata.interfaces import Policy, VecEnv
from swarmdata.online_algos.imitation.avoiding_team import AvoidingTeam
from swarmdata.online_algos.imitation.teacher_cloning import Teacher
from swarmdata.registry.components import make_policy, policy_class
from swarmdata.rollouts.side_env import AnyEnv, SideEnv, whole_of
from swarmdata.rollouts.side_policy import rows_of_side
from swarmdata.specs.task_spec import TaskSpec
from swarmdata.types import Float, Int, Step


@dataclass(frozen=True)
class TeacherSettings:
    """A teacher, and how careful it is."""

    teacher: str = ""  # registered policy that the actors clone
    teacher_margin: float = 0.0  # metres added to the radii that it plans with, for clones
    avoidance: bool = False  # keeps what is cloned from contacts
    surface_margin: float = 0.02  # metres that `avoidance` keeps from surfaces: `avoiding_team`
    teacher_remembers: bool = True  # otherwise it decides from the robots' observations alone

    def __post_init__(self) -> None:
        if self.teacher_margin and not self.teacher:
            raise SpecError(
                "teacher_margin is set without a teacher; set teacher too, or leave the margin out"
            )


def make_teacher(settings: TeacherSettings, spec: TaskSpec) -> Policy:
    """Builds the registered policy that is cloned in the task that `spec` describes.

    Raises:
        UnknownNameError: there is no such policy.
    """
    if settings.teacher_margin:
        spec = _with_larger_robots(spec, settings.teacher_margin)
    if settings.teacher_remembers:
        return make_policy(settings.teacher, spec)
    if "remembers" not in inspect.signature(policy_class(settings.teacher, spec)).parameters:
        raise SpecError(
            f"teacher_remembers is false, but policy {settings.teacher!r} of task {spec.task} "
            "cannot decide without its memory, as 'scripted' of task search can. Leave it out."
        )
    return make_policy(settings.teacher, spec, remembers=False)


def teacher_of(settings: TeacherSettings, env: AnyEnv) -> Teacher:
    """Builds the registered policy that is cloned, for the robots that act in `env`.

    Raises as `make_teacher` and `kept_safe` do.
    """
    whole = whole_of(env)
    teacher = kept_safe(make_teacher(settings, whole.spec), settings, whole)
    return _TeacherOfSide(teacher, env) if isinstance(env, SideEnv) else teacher


def kept_safe(teacher: Teacher, settings: TeacherSettings, env: VecEnv) -> Teacher:
    """Returns the teacher, kept from contacts if `avoidance` is set; SpecError for other robots."""
    if settings.avoidance:
        return AvoidingTeam(teacher, env, settings.surface_margin)
    return teacher


class _TeacherOfSide:
    """Implements `Teacher`: what a teacher of all sides does with the robots of one."""

    def __init__(self, teacher: Teacher, env: SideEnv) -> None:
        self._teacher, self._env = teacher, env

    def reset(self, step: Step, copies: Int) -> None:
        self._teacher.reset(self._env.whole_step, copies)

    def act(self, step: Step) -> Float:
        """Returns the actions in `step`, which is the last one of the copies, [E, N, A]."""
        actions = self._teacher.act(self._env.whole_step)
        return rows_of_side("actions", actions, self._env.spec.agents)


def _with_larger_robots(spec: TaskSpec, margin: float) -> TaskSpec:
    """The spec with radii larger by `margin`, m."""
    team = []
    for role in spec.team:
        robot = role.robot.model_copy(update={"radius": role.robot.radius + margin})
        team.append(role.model_copy(update={"robot": robot}))
    return spec.model_copy(update={"team": tuple(team)})
