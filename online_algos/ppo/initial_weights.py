"""Weights that MAPPO's actors start from: random, of other policies, or of a teacher's clone."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from swarmdata.behavior_policies.checkpoint_files import read_checkpoint
from swarmdata.behavior_policies.exact_actor import load_actor
from swarmdata.errors import BuildError, CheckpointError, SpecError
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.policy_file import last_policy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.actors.mean_actors import Actors
from swarmdata.online_algos.collection.training_worlds import Worlds
from swarmdata.online_algos.imitation.avoiding_team import ActorTeam
from swarmdata.online_algos.imitation.teacher_cloning import CloneConfig, Teacher, clone_teacher
from swarmdata.online_algos.imitation.teachers import TeacherSettings, kept_safe, teacher_of
from swarmdata.online_algos.runs.export_policy import restored
from swarmdata.perception.frames import Frame
from swarmdata.registry.recipes import FAMILY_SPECS, checkpoints
from swarmdata.registry.tiers import FAMILIES, TRAINED_TIERS
from swarmdata.rollouts.side_env import SideEnv


@dataclass(frozen=True)
class StartConfig(TeacherSettings):
    """What the actors start from; without policies and a teacher, their random weights.

    With `avoidance` and no teacher, they clone their own policies, kept from contacts.

    Raises:
        SpecError: a setting of the teacher is wrong.
    """

    policies: str = ""  # a run's folder or a shipped tier
    clone_rounds: int = 10  # rounds of states that the teacher labels
    clone_steps: int = 256  # of a round, in each world; the next round goes on from there
    clone_noise: float = 0.1  # standard deviation of the actions in these rounds

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
        if start.teacher:
            teacher = teacher_of(start, worlds.env)
        else:
            teacher = _careful(started.copy(), start, worlds)
        clone_teacher(started, worlds, generators, teacher, config)
    return started


def _careful(actors: Actors, start: StartConfig, worlds: Worlds) -> Teacher:
    """Actors that are kept from contacts; SpecError for robots of one side."""
    if isinstance(worlds.env, SideEnv):
        raise SpecError(
            "start.avoidance without start.teacher is for tasks of one side, since it decides for "
            "all robots. Set start.teacher too, or leave it out"
        )
    return kept_safe(ActorTeam(actors, worlds), start, worlds.env)


def find_policy(source: str, seed: int, n_agents: int) -> Policy:
    """Returns the policy that a seed starts from, for a team of `n_agents`.

    `source` is a shipped tier, such as `formation-expert`, whose policy number `seed` it is (robot
    i acts as the trained robot number i modulo theirs), or the folder of a run.
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
    """Copies a policy's weights and input statistics into the actors of seed number `index`."""
    if not isinstance(policy, TorchPolicy) or policy.squash:
        raise CheckpointError(
            f"{source} holds policies of another algorithm ({type(policy).__name__}), expected "
            "perceptrons whose means are clipped. Start from a run of mappo without memory."
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
