"""The weights that MAPPO's actors start from: random, of other policies, or of a teacher's clone.

MAPPO learns from the steps of its present policies only, so that recorded data cannot be mixed in.
Of an offline run, it takes over actors whose actions are clipped; its critic begins anew.
"""

import inspect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from swarmdata.behavior_policies.checkpoint_files import read_checkpoint
from swarmdata.behavior_policies.exact_actor import load_actor
from swarmdata.errors import BuildError, CheckpointError, SpecError
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import last_policy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.continuation.offline_start import (
    OfflineStart,
    actor_of,
    as_text,
    frame_name,
    hidden_sizes,
    load_actors,
)
from swarmdata.online_algos.ppo.avoiding_team import ActorTeam, AvoidingTeam
from swarmdata.online_algos.ppo.networks import Actors
from swarmdata.online_algos.ppo.teacher_cloning import CloneConfig, Teacher, clone_teacher
from swarmdata.online_algos.runs.export_policy import restored
from swarmdata.perception.frames import Frame
from swarmdata.registry.components import make_policy, policy_class
from swarmdata.registry.recipes import FAMILY_SPECS, checkpoints
from swarmdata.registry.tiers import FAMILIES, TRAINED_TIERS
from swarmdata.specs.features import Feature
from swarmdata.specs.task_spec import TaskSpec


@dataclass(frozen=True)
class StartConfig:
    """What the actors start from; without policies and a teacher, their random weights.

    Raises:
        SpecError: there is no round of cloning or no step in one, the noise is not a standard
            deviation, a margin is negative, or the teacher's margin is given without a teacher.
    """

    policies: str = ""  # a run's folder or a shipped tier
    teacher: str = ""  # registered policy that the actors clone before training
    teacher_margin: float = 0.0  # metres added to the radii that it plans with, for clones
    avoidance: bool = False  # keeps the teacher, or else the policies, from contacts, for clones
    surface_margin: float = 0.02  # metres that `avoidance` keeps from surfaces: `avoiding_team`
    teacher_remembers: bool = True  # otherwise it decides from the robots' observations alone
    clone_rounds: int = 10  # rounds of states that the teacher labels
    clone_steps: int = 256  # of a round, in each world; the next round goes on from there
    clone_noise: float = 0.1  # standard deviation of the actions in these rounds

    def __post_init__(self) -> None:
        for name in ("clone_rounds", "clone_steps"):
            if getattr(self, name) < 1:
                raise SpecError(f"{name} is {getattr(self, name)}, expected at least 1")
        if not 0.0 <= self.clone_noise < math.inf:
            raise SpecError(
                f"clone_noise is {self.clone_noise:g}, expected a number that is not negative"
            )
        for name in ("teacher_margin", "surface_margin"):
            margin = getattr(self, name)
            if not 0.0 <= margin < math.inf:
                raise SpecError(f"{name} is {margin:g} m, expected a length that is not negative")
        if self.teacher_margin and not self.teacher:
            raise SpecError(
                "teacher_margin is set without a teacher; set teacher too, or leave the margin out"
            )

    @property
    def has_teacher(self) -> bool:
        """Whether the actors clone a teacher before training."""
        return self.avoidance or bool(self.teacher)


def initial_weights(
    start: StartConfig,
    actors: Actors,
    worlds: Worlds,
    generators: Sequence[np.random.Generator],
    seeds: Sequence[int],
) -> Actors:
    """Returns actors to start from: the policies, then their clone of a teacher, if there are any.

    The given ones stay as they are; `worlds`, to clone in, are left in the middle of episodes.

    Raises:
        BuildError: one of the seeds has no policy to start from.
        CheckpointError: the policies are not actors of these sizes, in this frame.
        SpecError: `start.avoidance` is for other robots, or there is nothing to clone.
        UnknownNameError: there is no such teacher.
    """
    if start.avoidance and not (start.policies or start.teacher):
        raise SpecError(
            "start.avoidance is set with nothing to clone; expected --set start.policies=RUN or "
            "--set start.teacher=NAME"
        )
    started = actors.copy()
    if start.policies:
        found = [find_policy(start.policies, seed, worlds.sizes.n_agents) for seed in seeds]
        for index, policy in enumerate(found):
            copy_weights(policy, started, index, worlds.frame, start.policies)
    if start.has_teacher:
        config = CloneConfig(
            n_rounds=start.clone_rounds, rollout_steps=start.clone_steps, noise=start.clone_noise
        )
        teacher: Teacher = ActorTeam(started.copy(), worlds)
        if start.teacher:
            teacher = make_teacher(start, worlds.env.spec)
        if start.avoidance:
            teacher = AvoidingTeam(teacher, worlds.env, start.surface_margin)
        clone_teacher(started, worlds, generators, teacher, config)
    return started


def make_teacher(start: StartConfig, spec: TaskSpec) -> Policy:
    """Builds the registered policy that is cloned in the task that `spec` describes.

    With `teacher_margin`, it plans for larger robots, so that its clones, which are not exact, make
    contact less often.

    Raises:
        SpecError: the policy has no memory that it can do without.
        UnknownNameError: there is no such policy.
    """
    if start.teacher_margin:
        spec = _with_larger_robots(spec, start.teacher_margin)
    if start.teacher_remembers:
        return make_policy(start.teacher, spec)
    if "remembers" not in inspect.signature(policy_class(start.teacher, spec)).parameters:
        raise SpecError(
            f"start.teacher_remembers is false, but policy {start.teacher!r} of task {spec.task} "
            "cannot decide without its memory, as 'scripted' of task search can. Leave it out."
        )
    return make_policy(start.teacher, spec, remembers=False)


def _with_larger_robots(spec: TaskSpec, margin: float) -> TaskSpec:
    """The spec with radii larger by `margin`, m."""
    team = []
    for role in spec.team:
        robot = role.robot.model_copy(update={"radius": role.robot.radius + margin})
        team.append(role.model_copy(update={"robot": robot}))
    return spec.model_copy(update={"team": tuple(team)})


def find_policy(source: str, seed: int, n_agents: int) -> Policy:
    """Returns the policy that a seed starts from.

    Args:
        source: a shipped tier, such as `formation-expert`, whose policy number `seed` it is, or
            the folder of a run, whose last policy of that seed it is.
        seed: of the run that starts.
        n_agents: robots of its team. A shipped policy is adapted to it: robot i acts as the trained
            robot number i modulo theirs.

    Raises:
        BuildError: there is no such policy.
    """
    shipped = {f"{family}-{tier}": (family, tier) for family in FAMILIES for tier in TRAINED_TIERS}
    if source not in shipped:
        return last_policy(Path(source), seed)
    family, tier = shipped[source]
    found = checkpoints(family, tier)
    if seed >= len(found):
        raise BuildError(
            f"seed {seed} has no policy to start from: {source} ships {len(found)}. Train seeds "
            f"below {len(found)}, or start from the folder of a run."
        )
    data = read_checkpoint(found[seed].file, found[seed].sha256)
    return restored(load_actor(data, FAMILY_SPECS[family].n_agents, found[seed].file), n_agents)


def copy_weights(
    policy: Policy, actors: Actors, index: int, frame: Frame | None, source: str
) -> None:
    """Copies a policy's weights and input statistics into the actors of seed number `index`.

    Args:
        policy: to copy.
        actors: to write to.
        index: of the seed.
        frame: in which the actors are to act.
        source: where the policy is from, for messages.

    Raises:
        CheckpointError: the policy is not an actor of these sizes, in this frame.
    """
    if not isinstance(policy, TorchPolicy) or policy.squash:
        raise CheckpointError(
            f"{source} holds policies of another algorithm, expected actors whose means are "
            "clipped. Start from a run of mappo."
        )
    if policy.frame != frame or policy.parameters != actors.parameters:
        raise CheckpointError(
            f"{source} holds {policy.parameters} actors in frame {policy.frame}, expected "
            f"{actors.parameters} ones in {frame}. Start from a run of mappo with the same "
            "frame and parameters, or train with those of that run."
        )
    rows = slice(index * actors.n_rows, (index + 1) * actors.n_rows)
    actors.network.load_layers(rows, policy.layers)
    actors.input_mean[index] = policy.observation_mean.numpy()
    actors.input_std[index] = policy.observation_std.numpy()


WHEN_STARTED = {"std": "0.2", "critic_warmup_fraction": "0.1"}
"""Settings of a training that starts from an offline run, where the user gives no others.

The advantages of an untrained critic would undo the policy, and so would a beginner's noise."""


def settings_of(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
    """Returns the settings of the run's actors, and `WHEN_STARTED`.

    Raises:
        CheckpointError: the run's policies are no actors whose actions are clipped, or have other
            hidden layers than two of one width.
    """
    actor = actor_of(start, squash=False)
    hidden = hidden_sizes(actor.layers)
    if len(hidden) != 2 or hidden[0] != hidden[1]:
        raise CheckpointError(
            f"the actors of {start.name} have hidden layers of {as_text(hidden)} units, expected "
            "two of the same width, as mappo has them."
        )
    frame = frame_name(actor.frame, features)
    return {
        "hidden": str(hidden[0]), "parameters": actor.parameters, "frame": frame, **WHEN_STARTED
    }  # fmt: skip


def start_from(self: Any, start: OfflineStart) -> list[str]:
    """Takes over actors and the statistics of their inputs; a method of `MAPPO`.

    Raises:
        CheckpointError: the actors do not fit.
        SpecError: `config.start` names other policies or a teacher.
    """
    if self.config.start != StartConfig():
        raise SpecError(
            f"the settings start.* name other policies or a teacher, but training starts from "
            f"{start.name}; leave one of them out"
        )
    actors: Actors = self.actors
    load_actors(start, self.seeds, self.policy(0), actors.network)
    actors.input_mean, actors.input_std = start.moments(len(self.seeds))[:2]
    return [f"The critic begins anew: {start.run.algorithm} has none of mappo's kind."]
