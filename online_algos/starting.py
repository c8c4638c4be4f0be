"""What MAPPO's actors start from, if not from random weights: another run, or a teacher."""

from pathlib import Path
from typing import TYPE_CHECKING

from swarmdata.errors import CheckpointError
from swarmdata.interfaces import Policy
from swarmdata.learn.policy import TorchPolicy
from swarmdata.online_algos.cloning import CloneConfig, clone_teacher
from swarmdata.online_algos.run_folder import last_policy
from swarmdata.registry import make_policy

if TYPE_CHECKING:
    from swarmdata.online_algos.mappo import MAPPO


def start_actors(run: "MAPPO") -> None:
    """Takes over the last policies of `config.start`, then clones `config.teacher`, as far as set.

    Args:
        run: before its first update; its actors are changed in place.

    Raises:
        BuildError: `config.start` has no policy of one of the seeds.
        CheckpointError: its policies are not such actors as the run has.
        UnknownNameError: there is no such teacher.
    """
    if run.config.start:
        for index, seed in enumerate(run.seeds):
            take_over(run, index, last_policy(Path(run.config.start), seed))
    if run.config.teacher:
        clone_teacher(run, make_policy(run.config.teacher, run.worlds.env.spec), CloneConfig())


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
