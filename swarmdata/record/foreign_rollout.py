"""Plays trained policies in the environments that datasets were recorded in."""

from collections.abc import Callable
from itertools import compress
from typing import Any

import numpy as np

from swarmdata.errors import SchemaError
from swarmdata.interfaces import Policy, check_acts
from swarmdata.record.agent_reader import AgentReader, Presence
from swarmdata.record.joint_environment import as_parallel
from swarmdata.record.recording_description import describe_agents, state_source
from swarmdata.rollouts.function_policy import FunctionPolicy
from swarmdata.runtime.native_libraries import ThreadLimit
from swarmdata.specs.action_scaling import ActionScale, action_scale, choices_of
from swarmdata.specs.origins import RecordedSpec
from swarmdata.specs.spaces import to_float32, unflatten
from swarmdata.types import Bool, EvalResult, FloatOrByte, Seeds, Step, blank_step

PLAYED_METRICS = ("return", "length", "success")
"""Metrics of each episode; success is NaN if the environment does not report it."""


def policy_actions(
    policy: Policy, spec: RecordedSpec, step: Step, allowed: Bool | None = None
) -> dict[str, Any]:
    """Returns a policy's actions by agent, in the units of the environment.

    Args:
        policy: acts in [-1, 1], which is mapped to the bounds of the actions, or chooses among
            discrete actions as they were recorded; a `FunctionPolicy` in the units that it names.
        spec: spec of the recording.
        step: what the agents observe in one copy; see `step_of`.
        allowed: choices that the environment allows, [N, C] as in `action_masks`; None: all.

    Raises:
        SchemaError: the environment's actions are unbounded or of mixed kinds, the policy chose an
            action that does not exist, it has no `act_among` and there are masks, or it is a
            function whose units are not known.
    """
    choices = choices_of(spec)
    scale = None if choices else action_scale(spec)
    if isinstance(policy, FunctionPolicy):
        _check_units(policy, spec, scale)
    if allowed is None:
        actions = policy.act(step)[0]
    elif act_among := getattr(policy, "act_among", None):
        actions = act_among(step, allowed[None])[0]
    else:
        raise SchemaError(
            "the environment has action masks, but the policy ignores them: "
            f"{type(policy).__name__} has no act_among(step, allowed). Policies of vdn and qmix "
            "have it."
        )
    for agent, row, columns in zip(spec.agents, actions, choices, strict=False):
        for column, (choice, known) in enumerate(zip(row, columns, strict=False)):
            if float(choice) not in known:
                raise SchemaError(
                    f"the policy chose {choice:g} in column {column} of the action of "
                    f"{agent.name}, expected a whole number from {known.start} to "
                    f"{known.stop - 1}. Train it with an algorithm that learns choices."
                )
    rows = actions if scale is None else scale.to_environment(actions)
    agents = zip(spec.agents, rows, strict=True)
    return {agent.name: unflatten(agent.action, row) for agent, row in agents}


def _check_units(policy: FunctionPolicy, spec: RecordedSpec, scale: ActionScale | None) -> None:
    """Refuses a function that may mean other actions than the environment would get."""
    if scale is None and (policy.units is None or policy.units == "unit"):
        raise SchemaError(
            f"the actions of {spec.task} are choices, but the FunctionPolicy acts in [-1, 1]. Say "
            "that it chooses as recorded: FunctionPolicy(act, units=dataset.spec)."
        )
    if scale is not None and policy.units is None and not scale.is_identity:
        raise SchemaError(
            f"the actions of {spec.task} have other bounds than -1 and 1, but the FunctionPolicy "
            "does not say in which units it acts. Pass units=dataset.spec if it learned from "
            "episodes or transitions(), which are in the environment's units, or units='unit' if "
            "it learned from batches of a sampler, which are in [-1, 1]."
        )


def step_of(observations: FloatOrByte, state: FloatOrByte, *, seed: int, time: int) -> Step:
    """Returns the `Step` of one copy that a policy acts on.

    Args:
        observations: padded to the widest agent, zero for absent agents, [N, O]; images of bytes
            become float32, as every policy takes them.
        state: [S], likewise.
        seed: seed of the episode.
        time: steps since its reset.
    """
    return blank_step(
        observations[None].astype(np.float32, copy=False),
        state[None].astype(np.float32, copy=False),
        events=np.zeros((1, len(observations), 0), np.uint8),
        seeds=np.array([seed], np.uint64),
        times=np.array([time]),
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

    Policies act in [-1, 1], as the algorithms of this library learn from batches, and the
    environment gets the affine map of that to the bounds of its actions; choices are passed on.

    Args:
        policy: such as `swarmdata.train` returns, or a `FunctionPolicy`, whose `units` say whether
            it acts in [-1, 1] or in the environment's units. If the environment has action masks,
            the policy needs `act_among(step, allowed)`.
        make_env: makes an environment like the recorded one; it is closed at the end.
        spec: spec of the recording.
        seeds: seeds of the resets, such as `swarmdata.foreign_evaluation_seeds(100)`, [n].
        name: the policy's name in tables.

    Raises:
        SchemaError: the environment differs from the recorded one, there are no seeds, it is no
            policy, or its actions do not fit the environment or are in unknown units.
    """
    check_acts(policy, "reset", "act")
    if not len(seeds):
        raise SchemaError("there are no seeds, expected at least one episode to play")
    env = as_parallel(make_env())
    reader = AgentReader(tuple(env.possible_agents), describe_agents(env))
    if reader.agents != spec.agents:
        raise SchemaError(
            f"the environment has the agents {reader.agents}, the recording of {spec.task} has "
            f"{spec.agents}. Make it with the options of the recording: {spec.options}."
        )
    limit = ThreadLimit()
    try:
        rows = np.array([_play(policy, env, reader, spec, int(seed), limit) for seed in seeds])
    finally:
        env.close()
    metrics = dict(zip(PLAYED_METRICS, rows.T.copy(), strict=True))
    return EvalResult(name, spec.task, spec.hash(), np.asarray(seeds, np.uint64), metrics)


def _play(
    policy: Policy, env: Any, reader: AgentReader, spec: RecordedSpec, seed: int, limit: ThreadLimit
) -> tuple[float, float, float]:
    """Plays one episode: return, length, success."""
    observations, infos = env.reset(seed=seed)
    presence = Presence.after_reset(reader, env.agents)
    alive, team_return, time = presence.alive, 0.0, 0
    wanted = "auto" if spec.state_from == "poses" else spec.state_from  # of logs, none of an env
    source, _ = state_source(env, reader, wanted)
    seen = alive
    while alive.any():
        rows, state = reader.observations(observations, seen)
        if source == "environment":
            state = to_float32(np.ravel(env.state()), "state()")
        step = step_of(rows, state, seed=seed, time=time)
        if time == 0:
            policy.reset(step, np.zeros(1, np.int64))
        allowed = None
        if reader.has_masks(observations, infos):
            allowed = reader.masks(observations, infos, alive)
        with limit:  # not while the environment works
            chosen = policy_actions(policy, spec, step, allowed)
        acted = alive
        actions = {name: chosen[str(name)] for name in compress(reader.names, acted)}
        observations, rewards, terminations, truncations, infos = env.step(actions)
        ended = reader.flags(terminations, acted) | reader.flags(truncations, acted)
        alive = presence.step(ended, env.agents, infos)
        seen = alive | acted
        team_return += float(reader.numbers(rewards, acted, "reward").mean(dtype=np.float64))
        time += 1
    outcome = presence.outcome
    success = float("nan") if outcome is None else float(outcome == "success")
    return team_return, float(time), success
