"""OfflineStart: an offline run whose networks online training begins with.

Online training takes over the run's frame, the statistics that normalize its inputs, and the sizes
of its networks, so that its first policies act as those of the run do, bit for bit. An algorithm's
`settings_of` returns the settings to start with, as text; those that a user gives win. Its
`start_from` takes over what fits, and returns a sentence on all else.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np

from swarmdata.errors import CheckpointError, SchemaError
from swarmdata.interfaces import Algorithm, Policy
from swarmdata.learn.networks.critics import RobotCritics
from swarmdata.learn.networks.dataset_statistics import Statistics
from swarmdata.learn.networks.perceptrons import Layer, StackedLayers, present
from swarmdata.learn.policies.choice_policy import BinPolicy, ChoicePolicy
from swarmdata.learn.policies.torch_policy import TorchPolicy
from swarmdata.learn.training.run_files import find_run, is_online, run_folders, run_hash
from swarmdata.learn.training.run_folder import OfflineRun, load_last
from swarmdata.online_algos.collection.input_moments import InputMoments
from swarmdata.perception.frames import Frame
from swarmdata.runtime.documents import parse_json
from swarmdata.specs.features import Feature
from swarmdata.specs.frozen import Frozen, describe_differences
from swarmdata.specs.origins import SideSpec
from swarmdata.specs.plain_names import Sha256
from swarmdata.specs.task_spec import TaskSpec

Startable = TorchPolicy | BinPolicy | ChoicePolicy
"""Policies of networks that online training begins with."""


class StartSource(Frozen):
    """Which run another one starts from, as its `config.json` keeps it."""

    folder: str  # or its name in the zoo, as it was given
    content: Sha256  # of the run's files, `run_files.run_hash`


@dataclass(frozen=True, slots=True, eq=False)
class OfflineStart:
    """An offline run as of its last checkpoint."""

    source: StartSource
    run: OfflineRun
    algorithm: Algorithm
    statistics: Statistics
    is_compact: bool  # it has no critics any more

    @property
    def name(self) -> str:
        return self.source.folder

    @property
    def reward_scale(self) -> float:
        """Factor on rewards in the run's values: 1 / standard deviation of the returns-to-go."""
        return 1 / self.statistics.return_std

    @property
    def discount(self) -> float:
        return float(self.run.config["discount"])

    @property
    def has_other_rewards(self) -> bool:
        """Whether the run learned from other weights of rewards than those that were recorded."""
        return _changes_rewards(self.run.view)

    def policy(self, seed: int) -> Policy:
        """Returns the policy of a seed; errors as of `index`."""
        return self.algorithm.policy(self.index(seed))

    def index(self, seed: int) -> int:
        """Returns the number of a seed among those of the run."""
        if seed not in self.run.seeds:
            raise CheckpointError(
                f"{self.name} has the seeds {', '.join(map(str, self.run.seeds))}, expected seed "
                f"{seed} among them, whose policy this seed starts from. Train the seeds of that "
                "run with --seeds and --first-seed."
            )
        return self.run.seeds.index(seed)

    def moments(self, n_seeds: int) -> InputMoments:
        """Returns the statistics that normalize the run's inputs, alike for all seeds, float64."""
        s = self.statistics
        parts = (s.observation_mean, s.observation_std, s.state_mean, s.state_std)
        return InputMoments(
            *(np.tile(np.asarray(part, np.float64), (n_seeds, 1)) for part in parts)
        )


def _changes_rewards(view: str | None) -> bool:
    """Whether a view of a dataset, or of a part of a mixture, has other weights of rewards."""
    changes = {} if view is None else parse_json(view, "the view")
    parts = changes.get("mixture", ())
    return "rewards" in changes or any(_changes_rewards(part["view"]) for part in parts)


def read_start(name: Path | str) -> OfflineStart:
    """Reads the run to start from, a folder or `zoo:ALGORITHM/DATASET`."""
    path = find_run(name) or Path(name)
    if is_online((run_folders(path) or (path,))[0]):
        raise CheckpointError(
            f"{name} is a run of online training, expected an offline run to start from. mappo "
            "starts from runs of mappo with --set start.policies=RUN."
        )
    loaded = load_last(path)
    source = StartSource(folder=str(name), content=run_hash(path, 0))
    return OfflineStart(source, loaded.run, loaded.algorithm, loaded.statistics, loaded.is_compact)


def check_task(start: OfflineStart, spec: TaskSpec | SideSpec) -> None:
    """Raises CheckpointError if a run was trained for another task."""
    if start.run.spec_hash == spec.hash():
        return
    raise CheckpointError(
        f"{start.name} was trained for {start.run.spec.task} on {start.run.dataset}, which differs "
        f"from this task in: {describe_differences(start.run.spec, spec)}. Train in the task of "
        "that run, or start from a run for this one."
    )


def begin_with(
    name: Path | str, kind: Any, spec: TaskSpec | SideSpec, features: Sequence[Feature]
) -> tuple[OfflineStart, dict[str, str]]:
    """Reads a run for a task, and the settings that an online algorithm's class takes over.

    `features` are those of the task's observations.

    Raises:
        CheckpointError: it is no offline run for this task, or its policies do not fit.
        SchemaError: the class takes over nothing.
    """
    start = read_start(name)
    check_task(start, spec)
    if not hasattr(kind, "settings_of"):
        raise SchemaError(
            f"{kind.__name__} cannot start from an offline run, since it has no settings_of. Leave "
            "out the start, or use another online algorithm."
        )
    return start, kind.settings_of(start, features)


def frame_name(frame: Frame | None, features: Sequence[Feature]) -> str:
    """Returns the name by which `frames.find_frame` finds a frame."""
    names = [feature.name for feature in features]
    return "world" if frame is None else frame.anchor_of(names)


def hidden_sizes(layers: Sequence[Layer]) -> tuple[int, ...]:
    """Returns the widths of the hidden layers of networks."""
    return tuple(layer.weight.shape[-1] for layer in layers[:-1])


def as_text(sizes: Sequence[int]) -> str:
    """Returns sizes of layers as settings have them."""
    return ",".join(map(str, sizes))


def actor_of(start: OfflineStart, *, squash: bool) -> TorchPolicy:
    """Returns the run's first policy, whose actions pass through tanh, or are clipped."""
    policy = start.algorithm.policy(0)
    if isinstance(policy, TorchPolicy) and policy.squash == squash:
        return policy
    cure = (
        "an actor-critic, or bc with its default output" if squash else "bc with --set output=clip"
    )
    raise CheckpointError(
        f"{start.name} holds policies of {start.run.algorithm} ({type(policy).__name__}), expected "
        f"perceptrons whose actions {'pass through tanh' if squash else 'are clipped'}. Start from "
        f"a run of {cure}, without memory and with policy_network=mlp."
    )


def actor_settings(start: OfflineStart, features: Sequence[Feature]) -> dict[str, str]:
    """Returns the settings of the run's actors."""
    actor = actor_of(start, squash=False)
    hidden = hidden_sizes(actor.layers)
    if len(hidden) != 2 or hidden[0] != hidden[1]:
        raise CheckpointError(
            f"the actors of {start.name} have hidden layers of {as_text(hidden)} units, expected "
            "two of the same width, as mappo and dagger have them."
        )
    frame = frame_name(actor.frame, features)
    return {"hidden": str(hidden[0]), "parameters": actor.parameters, "frame": frame}


def load_actors(
    start: OfflineStart, seeds: Sequence[int], fitting: TorchPolicy, network: StackedLayers
) -> None:
    """Copies the run's actors of some seeds to `network`, which has as many rows for each.

    Raises:
        CheckpointError: the run lacks a seed, or its policies are not as `fitting`.
    """
    actor_of(start, squash=fitting.squash)
    actors = [cast("TorchPolicy", start.policy(seed)) for seed in seeds]
    check_fit(start, "actors", fitting, actors[0])
    n_rows = len(network.flat) // len(seeds)
    for k, actor in enumerate(actors):
        network.load_layers(slice(k * n_rows, (k + 1) * n_rows), actor.layers)


def check_fit(start: OfflineStart, what: str, fitting: Startable, theirs: Startable) -> None:
    """Raises CheckpointError unless the networks of a run can be copied."""
    for name, one, other in (
        ("the frame", fitting.frame, theirs.frame),
        ("parameters", fitting.parameters, theirs.parameters),
        ("weights of shapes", _shapes(fitting), _shapes(theirs)),
    ):
        if one != other:
            raise CheckpointError(
                f"the {what} of {start.name} have {name} {other}, expected {one}. Leave out the "
                f"settings of the frame and of the {what}: they are taken over from that run."
            )


def _shapes(policy: Startable) -> list[list[tuple[int, ...]]]:
    return [[tuple(weight.shape) for weight in present(layer)] for layer in policy.layers]


def robot_critics_of(start: OfflineStart) -> RobotCritics | str:
    """Returns the run's critics of each robot's own reward; a reason if it has none.

    They go on, with their slow copies, in the run's units of reward and with its discount.
    """
    critics = getattr(start.algorithm, "critics", None)
    if start.is_compact:
        return "its checkpoint was made small and has none"
    if not isinstance(critics, RobotCritics):
        return f"{start.run.algorithm} has none of each robot"
    if start.run.config["reward"] != "own":
        return "they value the team's reward, not each robot's own"
    if start.has_other_rewards:
        return "they value other weights of rewards than the task's"
    return critics


def settings_of_critics(start: OfflineStart, critics: RobotCritics) -> dict[str, str]:
    """The settings of the critics, of what they value, and a short warm-up, as text."""
    return {
        "critic": critics.critic,
        "critic_hidden": as_text(hidden_sizes(critics.online.layers)),
        "discount": str(start.discount),
        "reward_scale": str(1 / start.statistics.own_return_std),
        "critic_warmup_updates": "500",
    }


def load_critics(mine: RobotCritics, start: OfflineStart, seeds: Sequence[int]) -> list[str]:
    """Copies critics of some seeds, and their slow copies; returns a sentence if they are unfit."""
    theirs, n = robot_critics_of(start), mine.n_critics
    if isinstance(theirs, str):
        return [f"The critics begin anew, not with those of {start.name}: {theirs}."]
    kinds = [(each.critic, each.n_critics, each.online.shape) for each in (mine, theirs)]
    if kinds[0] != kinds[1]:
        return [
            f"The critics begin anew, not with those of {start.name}: they are {kinds[1]}, "
            f"expected {kinds[0]}. Leave out the settings of the critics to take them over."
        ]
    for k, seed in enumerate(seeds):
        to, index = slice(k * n, (k + 1) * n), start.index(seed)
        of = slice(index * n, (index + 1) * n)
        mine.online.flat[to] = theirs.online.flat[of]
        mine.target.flat[to] = theirs.target.flat[of]
    return []
