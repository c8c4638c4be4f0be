"""Random scenes for the NumPy twins of sensors."""

from typing import Any

from hypothesis import strategies as st


def scene_cases(most_agents: int = 8, **model: Any) -> st.SearchStrategy[dict[str, Any]]:
    """Arguments of `Scenes.compare`.

    Args:
        most_agents: of a team.
        model: fields of the observation model, or what draws them.
    """
    drawn = {k: v if isinstance(v, st.SearchStrategy) else st.just(v) for k, v in model.items()}
    robots = st.fixed_dictionaries(
        {
            "dynamics": st.sampled_from(["holonomic", "unicycle"]),
            "sensor_range": st.none() | st.floats(0.1, 3.0),
        }
    )
    return st.fixed_dictionaries(
        {
            "model": st.fixed_dictionaries(drawn),
            "robot": robots,
            "n_agents": st.integers(1, most_agents),
            "has_bodies": st.booleans(),
            "seed": st.integers(0, 2**32),
        }
    )
