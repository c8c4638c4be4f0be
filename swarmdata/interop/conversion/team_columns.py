"""How the columns of a team are divided among its agents, for formats that store them together."""

from collections.abc import Sequence
from typing import Any

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.foreign_file import reading
from swarmdata.interop.conversion.foreign_rows import agent_columns, columns_of, count_choices
from swarmdata.interop.conversion.imported_data import AgentShapes
from swarmdata.interop.conversion.user_choices import Choices


def team_shapes(
    observations: Sequence[int], actions: Any, choices: Choices, source: str, n_states: int = 0
) -> AgentShapes:
    """Returns the sizes of a team of equal agents: from the agent axis, else from the user.

    Args:
        observations: shape of the observations, [n, O], [n, N * O] or [n, N, O].
        actions: array or file of the actions, [n, ...]; all are read if they are whole numbers.
        choices: the user's answers.
        source: name for errors.
        n_states: columns of the state, 0 without states.

    Raises:
        ConversionError: the columns cannot be divided among the agents.
    """
    if len(observations) > 3:
        raise ConversionError(
            f"{source} has observations of shape {tuple(observations)}, expected [n, O], "
            "[n, N * O] or [n, N, O]"
        )
    n_agents = int(observations[1]) if len(observations) > 2 else choices.n_agents or 1
    if choices.n_agents not in (None, n_agents) or not n_agents:
        raise ConversionError(
            f"{source} has observations of shape {tuple(observations)}, which does not fit "
            f"{choices.n_agents or n_agents} agents"
        )
    sizes = {"observations": columns_of(observations), "actions": columns_of(actions.shape)}
    if wrong := {name: size for name, size in sizes.items() if size % n_agents}:
        raise ConversionError(
            f"{source} has rows of sizes {wrong}, which cannot be divided among {n_agents} agents"
        )
    counts: tuple[int, ...] = ()
    if actions.dtype.kind in "iu":
        with reading(source):
            values = actions[:]
        counts = count_choices(agent_columns(values, n_agents, source), source)
    return AgentShapes(
        observations=(sizes["observations"] // n_agents,) * n_agents,
        actions=(sizes["actions"] // n_agents,) * n_agents,
        choices=(counts,) * n_agents,
        states=n_states,
    )
