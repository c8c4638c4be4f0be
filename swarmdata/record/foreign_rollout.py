"""Runs trained policies in the environments that datasets were recorded in."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from swarmdata.datasets.action_scaling import ActionScale, action_scale, choices_of
from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy
from swarmdata.record.foreign_environment import agents_of
from swarmdata.record.recording_description import state_source
from swarmdata.record.row_reader import Reader
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.spaces import unflatten
from swarmdata.types import Bool, Double, EvalResult, Float, Seeds, Step, no_messages

METRICS = ("return", "length", "success")
"""What is measured of each episode; success is NaN where the environment does not say."""


@runtime_checkable
class ChoosesAmong(Protocol):
    """A policy that can be told which choices are allowed."""

    def act_among(self, step: Step, allowed: Bool) -> Float:
        """Returns joint actions, [E, N, A], of allowed choices, bool [E, N, C] as recorded."""
        ...


def policy_actions(
    policy: Policy, spec: RecordedSpec, step: Step, allowed: Bool | None = None
) -> dict[str, Any]:
    """Returns a policy's actions as the environment takes them, by agent.

    Args:
        policy: acts in [-1, 1], or takes choices as they were recorded, as it was trained.
        spec: of the recording.
        step: what the agents see, of one copy: `step_of`.
        allowed: choices that the environment allows, [N, C] as `action_masks` has them; None: all.

    Raises:
        SchemaError: the environment's actions are without bounds or of mixed kinds, or the policy
            took what is no choice, or it cannot be told what is allowed.
    """
    return _in_units(_acts(policy, step, allowed), spec, _scale_of(spec))


def _scale_of(spec: RecordedSpec) -> ActionScale | None:
    """The map from [-1, 1]; None for choices."""
    return None if choices_of(spec) else action_scale(spec)


def _acts(policy: Policy, step: Step, allowed: Bool | None) -> Float:
    """A policy's joint action, [N, A]."""
    if allowed is None:
        return policy.act(step)[0]
    if not isinstance(policy, ChoosesAmong):
        raise SchemaError(
            "the environment says which choices are allowed, and the policy cannot be told: it "
            f"has no act_among(step, allowed), got {type(policy).__name__}. Policies of vdn and "
            "qmix have it."
        )
    return policy.act_among(step, allowed[None])[0]


def _in_units(actions: Float, spec: RecordedSpec, scale: ActionScale | None) -> dict[str, Any]:
    """Joint actions in [-1, 1], or choices, [N, A], as the environment takes them."""
    rows = actions if scale is None else scale.to_environment(actions)
    if scale is None:
        _check_choices(actions, spec)
    agents = zip(spec.agents, rows, strict=True)
    return {agent.name: unflatten(agent.action, row) for agent, row in agents}


def _check_choices(actions: Float, spec: RecordedSpec) -> None:
    """Raises SchemaError unless all actions are choices that there are."""
    for agent, row, columns in zip(spec.agents, actions, choices_of(spec), strict=True):
        for column, (choice, known) in enumerate(zip(row, columns, strict=False)):
            if float(choice) not in known:
                raise SchemaError(
                    f"the policy chose {choice:g} in column {column} of the action of "
                    f"{agent.name}, expected a whole number from {known.start} to "
                    f"{known.stop - 1}. Train it with an algorithm that learns choices."
                )


def step_of(observations: Float, state: Float, *, seed: int, time: int) -> Step:
    """Returns what a policy looks at, one copy.

    Args:
        observations: padded to the widest agent, zero of agents that are not there, [N, O].
        state: [S].
        seed: of the episode.
        time: steps taken since its reset.
    """
    n_agents = len(observations)
    return Step(
        observations=observations[None],
        states=state[None],
        rewards=np.zeros((1, n_agents), np.float32),
        terminations=np.zeros(1, np.bool_),
        truncations=np.zeros(1, np.bool_),
        successes=np.zeros(1, np.bool_),
        events=np.zeros((1, n_agents, 0), np.uint8),
        seeds=np.array([seed], np.uint64),
        times=np.array([time]),
        layouts=np.zeros((1, 0, 8), np.float32),
        **no_messages(1, n_agents),
    )


def evaluate_parallel(
    policy: Policy,
    make_env: Callable[[], Any],
    spec: RecordedSpec,
    seeds: Seeds,
    *,
    name: str = "policy",
) -> EvalResult:
    """Plays one episode for each seed with a policy that was trained on a recording.

    Args:
        policy: such as `swarmdata.train` returns. Where the environment says which choices are
            allowed, it must have `act_among`.
        make_env: gives a `ParallelEnv` like the recorded one; it is closed in the end.
        spec: of the recording.
        seeds: of the resets, such as `foreign_evaluation_seeds(100)`, [n].
        name: of the policy, for tables.

    Raises:
        SchemaError: the environment is not like the recorded one, there are no seeds, or the policy
            does not act as the environment needs it.
    """
    if not len(seeds):
        raise SchemaError("there are no seeds, expected at least one episode to play")
    env = make_env()
    reader = Reader(tuple(env.possible_agents), agents_of(env))
    if reader.agents != spec.agents:
        raise SchemaError(
            f"the environment has the agents {reader.agents}, the recording of {spec.task} has "
            f"{spec.agents}. Make it with the options of the recording: {spec.options}."
        )
    try:
        rows = np.array([_play(policy, env, reader, spec, int(seed)) for seed in seeds])
    finally:
        env.close()
    metrics: Mapping[str, Double] = dict(zip(METRICS, rows.T.copy(), strict=True))
    return EvalResult(name, spec.task, spec.hash(), np.asarray(seeds, np.uint64), metrics)


def _play(
    policy: Policy, env: Any, reader: Reader, spec: RecordedSpec, seed: int
) -> tuple[float, float, float]:
    """One episode: return, length, success."""
    observations, infos = env.reset(seed=seed)
    alive, total, time = reader.alive(env.agents), 0.0, 0
    source, _ = state_source(env, reader, spec.state_from)
    scale = _scale_of(spec)
    seen = alive
    while alive.any():
        rows, plain = reader.observations(observations, seen)
        state = plain if source == "observations" else np.ravel(env.state()).astype(np.float32)
        step = step_of(rows, state, seed=seed, time=time)
        if time == 0:
            policy.reset(step, np.zeros(1, np.int64))
        allowed = None
        if reader.has_masks(observations, infos):
            allowed = reader.masks(observations, infos, alive)
        acted, chosen = alive, _in_units(_acts(policy, step, allowed), spec, scale)
        observations, rewards, terminations, truncations, infos = env.step(
            _acting(chosen, reader, acted)
        )
        ended = reader.flags(terminations, acted) | reader.flags(truncations, acted)
        alive = reader.alive(env.agents) & ~ended
        seen = alive | acted
        total += float(reader.numbers(rewards, acted, "reward").mean(dtype=np.float64))
        time += 1
    outcome = reader.outcome(infos)
    success = float("nan") if outcome is None else float(outcome == "success")
    return total, float(time), success


def _acting(chosen: Mapping[str, Any], reader: Reader, acted: Bool) -> dict[Any, Any]:
    """The actions of who acts, by the environment's own names."""
    names = zip(reader.names, acted, strict=True)
    return {name: chosen[str(name)] for name, is_acting in names if is_acting}
