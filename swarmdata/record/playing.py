"""Runs trained policies in the environments that datasets were recorded in."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy
from swarmdata.origins import RecordedSpec
from swarmdata.record.describing import state_source
from swarmdata.record.foreign import agents_of
from swarmdata.record.reading import Reader
from swarmdata.scaling import ActionScale, action_scale
from swarmdata.spaces import unflatten
from swarmdata.types import Bool, Double, EvalResult, Float, Seeds, Step, no_messages

METRICS = ("return", "length", "success")
"""What is measured of each episode; success is NaN where the environment does not say."""


def policy_actions(policy: Policy, spec: RecordedSpec, step: Step) -> dict[str, Any]:
    """Returns a policy's actions as the environment takes them, by agent.

    Args:
        policy: chooses in [-1, 1], in which it was trained.
        spec: of the recording.
        step: what the agents see, of one copy: `step_of`.

    Raises:
        SchemaError: the environment's actions are choices, or without bounds.
    """
    return _in_units(policy.act(step)[0], spec, action_scale(spec))


def _in_units(unit: Float, spec: RecordedSpec, scale: ActionScale) -> dict[str, Any]:
    """Joint actions in [-1, 1], [N, A], as the environment takes them."""
    agents = zip(spec.agents, scale.to_environment(unit), strict=True)
    return {agent.name: unflatten(agent.action, row) for agent, row in agents}


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
        policy: chooses in [-1, 1], such as `learn.trainer.train` returns.
        make_env: gives a `ParallelEnv` like the recorded one; it is closed in the end.
        spec: of the recording.
        seeds: of the resets, such as `foreign_evaluation_seeds(100)`, [n].
        name: of the policy, for tables.

    Raises:
        SchemaError: the environment is not like the recorded one, or no seeds.
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
    scale = action_scale(spec)
    seen = alive
    while alive.any():
        rows, plain = reader.observations(observations, seen)
        state = plain if source == "observations" else np.ravel(env.state()).astype(np.float32)
        step = step_of(rows, state, seed=seed, time=time)
        if time == 0:
            policy.reset(step, np.zeros(1, np.int64))
        acted, chosen = alive, _in_units(policy.act(step)[0], spec, scale)
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
