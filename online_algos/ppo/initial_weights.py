"""What MAPPO's actors start from, if not from random weights: other policies, or a teacher."""

from pathlib import Path
from typing import TYPE_CHECKING

from swarmdata.behavior_policies.exact_actor import load_actor
from swarmdata.behavior_policies.learned import read_checkpoint
from swarmdata.behavior_policies.tiers import FAMILIES, FAMILY_SPECS, TRAINED_TIERS, checkpoints
from swarmdata.errors import BuildError, CheckpointError
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.online_algos.ppo.teacher_cloning import CloneConfig, clone_teacher
from swarmdata.online_algos.runs.export_policy import restored
from swarmdata.online_algos.runs.seed_files import last_policy
from swarmdata.registry.components import make_policy

if TYPE_CHECKING:
    from swarmdata.online_algos.mappo import MAPPO


def start_actors(run: "MAPPO") -> None:
    """Takes over the policies of `config.start`, then clones `config.teacher`, as far as set.

    Args:
        run: before its first update; its actors are changed in place.

    Raises:
        BuildError: `config.start` has no policy of one of the seeds.
        CheckpointError: its policies are not such actors as the run has.
        UnknownNameError: there is no such teacher.
    """
    if run.config.start:
        n_agents = run.worlds.sizes.n_agents
        found = [start_policy(run.config.start, seed, n_agents) for seed in run.seeds]
        for index, policy in enumerate(found):
            take_over(run, index, policy)
    if run.config.teacher:
        clone_teacher(
            run, make_policy(run.config.teacher, run.worlds.env.spec),
            CloneConfig(n_rounds=run.config.clone_rounds, noise=run.config.clone_noise),
        )  # fmt: skip


def start_policy(start: str, seed: int, n_agents: int) -> Policy:
    """The policy that a seed starts from.

    Args:
        start: a shipped tier, such as `formation-expert`, whose policy number `seed` it is; else
            the folder of a run, whose last policy of that seed it is.
        seed: of the run that starts.
        n_agents: robots of its team. A shipped policy is carried over to it, robot i as the
            trained one of number i modulo theirs.

    Raises:
        BuildError: there is no such policy.
    """
    shipped = {f"{family}-{tier}": (family, tier) for family in FAMILIES for tier in TRAINED_TIERS}
    if start not in shipped:
        return last_policy(Path(start), seed)
    family, tier = shipped[start]
    found = checkpoints(family, tier)
    if seed >= len(found):
        raise BuildError(
            f"seed {seed} has no policy to start from: {start} ships {len(found)}. Train seeds "
            f"below {len(found)}, or start from the folder of a run."
        )
    data = read_checkpoint(found[seed].file, found[seed].sha256)
    return restored(load_actor(data, FAMILY_SPECS[family].n_agents, found[seed].file), n_agents)


def take_over(run: "MAPPO", index: int, policy: Policy) -> None:
    """Starts the actors and the input statistics of seed number `index` from a policy.

    Raises:
        CheckpointError: it is not an actor of these sizes, in this frame.
    """
    where, frame = run.config.start, run.worlds.frame
    if not isinstance(policy, TorchPolicy) or policy.squash:
        raise CheckpointError(
            f"{where} holds policies of another algorithm, expected actors whose means are "
            "clipped. Start from a run of mappo."
        )
    if policy.frame != frame or policy.parameters != run.config.parameters:
        raise CheckpointError(
            f"{where} holds {policy.parameters} actors in frame {policy.frame}, expected "
            f"{run.config.parameters} ones in {frame}. Start from a run of mappo with the same "
            "frame and parameters, or train with those of that run."
        )
    run.actor.load_layers(slice(index * run.n_rows, (index + 1) * run.n_rows), policy.layers)
    run.input_mean[index] = policy.observation_mean.numpy()
    run.input_std[index] = policy.observation_std.numpy()
