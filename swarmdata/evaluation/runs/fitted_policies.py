"""Trained policies as they act in a world, or with models, other than those of their training."""

from collections.abc import Sequence

from swarmdata.errors import PolicyFitError
from swarmdata.interfaces import Policy
from swarmdata.learn.policies.set_policy import SetPolicy
from swarmdata.perception.observer import features_of
from swarmdata.registry.components import make_task
from swarmdata.specs.model_choice import check_senses
from swarmdata.specs.task_spec import TaskSpec


def fit_policies(
    name: str, policies: Sequence[Policy], trained: TaskSpec, offered: TaskSpec
) -> tuple[Policy, ...]:
    """Returns the policies of a run for another spec.

    Policies over sets act with other numbers of robots and slots; all others need those of their
    training.

    Args:
        name: of the run, for messages.
        policies: one per seed.
        trained: spec of their training.
        offered: spec to act in.

    Raises:
        PolicyFitError: the robots, their number, the features or the actions do not fit.
        SpecError: the vector that the policies' frame turns with is not observed.
    """
    if offered == trained:
        return tuple(policies)
    _check_robots(name, trained, offered)
    known, seen = (features_of(make_task(spec)) for spec in (trained, offered))
    fitted: list[Policy] = []
    for policy in policies:
        if isinstance(policy, SetPolicy) and trained.action_size == offered.action_size:
            fitted.append(policy.fitted(seen))
            continue
        if trained.n_agents != offered.n_agents and not isinstance(policy, SetPolicy):
            raise PolicyFitError(
                f"{name} was trained with {trained.n_agents} robots and cannot act with "
                f"{offered.n_agents}: its network sees the robot's number. Evaluate it with "
                f"{trained.n_agents} robots, or train with --set policy_network=deep_sets."
            )
        check_senses(name, trained, offered, known, seen)
        fitted.append(policy)
    return tuple(fitted)


def _check_robots(name: str, trained: TaskSpec, offered: TaskSpec) -> None:
    """Raises PolicyFitError if actions would mean something else."""
    known, found = (
        sorted({f"{robot.dynamics} with {robot.command} commands" for robot in spec.robots})
        for spec in (trained, offered)
    )
    if known != found:
        raise PolicyFitError(
            f"{name} was trained on robots that are {' and '.join(known)}, and cannot drive robots "
            f"that are {' and '.join(found)}. Evaluate it in a task with robots as in its training."
        )
