"""The card of a dataset of an environment that this package cannot simulate."""

from collections.abc import Sequence

import numpy as np

from swarmdata.cards.sections.front_matter import bullets, front_matter, identity_section
from swarmdata.cards.sections.origin import (
    about_section,
    origin_section,
    splits_section,
    tier_section,
)
from swarmdata.cards.sections.problem import arrays_table
from swarmdata.cards.sections.statistics import percent, statistics_text
from swarmdata.drawing import markdown
from swarmdata.specs.origins import Origin, Spec
from swarmdata.specs.spaces import (
    Bound,
    BoxSpace,
    DictSpace,
    DiscreteSpace,
    MultiBinarySpace,
    MultiDiscreteSpace,
    Space,
    TupleSpace,
    width,
)
from swarmdata.store import EpisodeTable, StoredDataset
from swarmdata.types import END_REASONS

FOREIGN_LIMITS = (
    "This package cannot simulate the environment: rewards and observations cannot be recomputed, "
    "and episodes cannot be observed again with other sensors.",
    "Nobody has verified that the episodes come from the policies named here.",
    "There is no normalized score, because no reference policies were measured.",
)

MOST_BOUNDS = 8  # bounds of a box that are listed one by one


def render_recorded(stored: StoredDataset, picture: str | None = None) -> str:
    """Returns the card's text; a picture, named by its file, replaces the histogram in text."""
    origin, table, spec = stored.recipe, stored.table, stored.recipe.spec
    holds, broken = _checked(table, spec)
    sections = (
        front_matter(stored.manifest, origin),
        identity_section(stored.manifest, origin),
        tier_section(origin),
        about_section(origin),
        _statistics(table, origin, picture),
        _policies(table, origin),
        splits_section(table, origin),
        bullets("Known limits", (*FOREIGN_LIMITS, *spec.limits, *_own_limits(stored), *broken)),
        _environment(spec, stored.manifest.arrays["observations"].shape[2]),
        _arrays(stored),
        bullets("Checks passed", holds),
        origin_section(origin, stored.manifest),
    )
    return "".join(sections)


def _environment(spec: Spec, n_columns: int) -> str:
    spaces = zip(spec.observation_spaces(n_columns), spec.action_spaces, strict=True)
    rows = [
        (f"`{name}`", describe(seen), str(width(seen)), describe(chosen), str(width(chosen)))
        for name, (seen, chosen) in zip(spec.agent_names, spaces, strict=True)
    ]
    head = ("agent", "observation", "columns", "action", "columns")
    horizon = "The maximum length of an episode is not known."
    if spec.horizon is not None:
        horizon = f"Episodes have at most {spec.horizon} steps."
    if spec.time_step is not None:
        horizon += f" A step takes {spec.time_step:g} s."
    return (
        "\n## Environment\n\n"
        + markdown.table(head, rows)
        + f"\nStates: {spec.state_meaning} {horizon} Values are stored as the environment "
        "exchanged them: the entries of dictionaries by sorted key, boxes in row-major order, a "
        "discrete choice as its number. Rows of agents with smaller spaces are padded with zeros "
        "on the right.\n"
    )


def describe(space: Space) -> str:
    """A space in a few words."""
    match space:
        case BoxSpace():
            shape = " x ".join(map(str, space.shape)) or "one"
            return f"box of {shape} in [{_bound(space.low, '-∞')}, {_bound(space.high, '∞')}]"
        case DiscreteSpace():
            return f"discrete, {space.start} to {space.start + space.n - 1}"
        case MultiDiscreteSpace():
            return f"discrete, {' x '.join(map(str, space.n))} choices"
        case MultiBinarySpace():
            return f"{space.n} bits"
        case DictSpace():
            return "; ".join(f"{key}: {describe(s)}" for key, s in sorted(space.spaces.items()))
        case TupleSpace():
            return "; ".join(describe(part) for part in space.spaces)


def _bound(bound: Bound, infinite: str) -> str:
    each = bound if isinstance(bound, tuple) else (bound,)
    texts = [infinite if value is None else f"{value:g}" for value in each]
    if len(texts) > MOST_BOUNDS:
        texts = [*texts[: MOST_BOUNDS - 1], "…"]
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def _arrays(stored: StoredDataset) -> str:
    text = f"{arrays_table(stored.manifest)}Arrays with an axis of length 0 were not recorded."
    if "alive" in stored.arrays:
        text += (
            " Agents can leave before the episode ends: `alive` marks the agents that act next. "
            "Observations, actions and rewards of agents that left are zero; the last observation "
            "of each agent is kept."
        )
    if "action_masks" in stored.arrays:
        text += " `action_masks` marks the choices that were allowed."
    return f"{text}\n"


def _policies(table: EpisodeTable, origin: Origin) -> str:
    rows = []
    for index, source in enumerate(origin.policies):
        own = table.take(np.flatnonzero(table.policy == index))
        if len(own):
            counts = f"{len(own):,}", f"{own.lengths.sum():,}"
            returns = f"{own.team_return.mean():.3f} ± {own.team_return.std():.3f}"
            length = f"{own.lengths.mean():.1f}"
            rows.append((source.label, source.title, *counts, returns, _success(own), length))
    head = ("id", "policy", "episodes", "steps", "return", "success", "length")
    return (
        "\n## Behavior policies\n\n"
        + markdown.table(head, rows)
        + "\nThe return of an episode is the sum over time of the mean reward over agents, given "
        "as mean ± standard deviation over episodes; lengths are mean joint steps. `external` "
        "policies are not part of swarmdata.\n"
    )


def _success(table: EpisodeTable) -> str:
    """Share of solved episodes, if the environment reports whether they are."""
    codes = [END_REASONS.index(reason) for reason in ("success", "failure")]
    return percent(table.success) if np.isin(table.end_reason, codes).any() else "not reported"


def _statistics(table: EpisodeTable, origin: Origin, picture: str | None) -> str:
    lengths = table.lengths
    rows = [
        ("success", _success(table)),
        ("length, min / mean / max", f"{lengths.min()} / {lengths.mean():.1f} / {lengths.max()}"),
    ]
    for code, reason in enumerate(END_REASONS):
        if (table.end_reason == code).any():
            name = "with success not reported" if reason == "ended" else f"by {reason}"
            rows.append((f"ended {name}", percent(table.end_reason == code)))
    shown = f"Returns, episode lengths and actions of {origin.id}"
    return statistics_text(table.team_return, rows, shown, picture)


def _checked(table: EpisodeTable, spec: Spec) -> tuple[Sequence[str], Sequence[str]]:
    holds, broken = ["Every return is finite."], []
    if len(np.unique(table.seeds)) == len(table):
        holds.append("No reset seed occurs twice.")
    else:
        broken.append("Some reset seeds occur twice.")
    if spec.horizon is not None and (table.lengths <= spec.horizon).all():
        holds.append("No episode is longer than the horizon.")
    elif spec.horizon is not None:
        broken.append("Some episodes are longer than the horizon.")
    return holds, broken


def _own_limits(stored: StoredDataset) -> list[str]:
    found = []
    if not stored.arrays["log_probs"].shape[1]:
        found.append("The log-probabilities of the actions were not recorded.")
    if _success(stored.table) == "not reported":
        found.append("The environment does not report whether its task was solved.")
    return found
