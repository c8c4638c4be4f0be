"""The card of a dataset that was recorded in another library's environment, or edited from such."""

from collections.abc import Sequence

import numpy as np

from swarmdata.cards.sections.front_matter import bullets, front_matter, snippet
from swarmdata.cards.sections.origin import (
    about_section,
    acting,
    origin_section,
    splits_section,
    tier_section,
)
from swarmdata.cards.sections.problem import OFFSETS
from swarmdata.cards.sections.statistics import histogram, percent
from swarmdata.drawing import markdown
from swarmdata.errors import SpecError
from swarmdata.specs.origins import Origin, RecordedSpec
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

LIMITS = (
    "What the environment does is known here by its name and version only: rewards and "
    "observations cannot be recomputed, and nothing can be seen with other sensors.",
    "Whether a policy was the one it is said to be, nobody checked.",
    "There is no normalized score: no reference policies were measured.",
)
"""Known limits of every recording of another environment."""

_SHORT = 8  # bounds that are shown one by one


def render_recorded(stored: StoredDataset, picture: str | None = None) -> str:
    """Returns the card's text; with a picture in the place of the histogram in text.

    Args:
        stored: the open dataset.
        picture: file name of its picture, if the card shows one.

    Raises:
        SpecError: it is of a task of this library.
    """
    origin, table = stored.recipe, stored.table
    spec = origin.spec
    if not isinstance(spec, RecordedSpec):
        raise SpecError(f"{origin.id} is of the task {spec.task}, which has a card of its own kind")
    holds, broken = _checked(table, spec)
    sections = (
        front_matter(stored.manifest, origin),
        _identity(stored, spec),
        tier_section(origin),
        about_section(origin),
        _environment(spec),
        _arrays(stored, spec),
        _policies(table, origin),
        _statistics(table, origin, picture),
        splits_section(table, origin),
        bullets("Checks passed", holds),
        bullets("Known limits", (*LIMITS, *_own_limits(stored, spec), *broken)),
        origin_section(origin, stored.manifest),
    )
    return "".join(sections)


def _identity(stored: StoredDataset, spec: RecordedSpec) -> str:
    manifest = stored.manifest
    size = sum(entry.size for entry in manifest.files.values())
    rows = (
        ("id", f"`{manifest.id}`"),
        ("environment", f"`{spec.task}`"),
        ("library", f"{spec.library} {spec.version}".strip() or "not known"),
        ("options", ", ".join(f"{k}={v!r}" for k, v in sorted(spec.options.items())) or "none"),
        ("tier", stored.recipe.tier),
        ("joint steps", f"{manifest.n_steps:,}"),
        ("episodes", f"{manifest.n_episodes:,}"),
        ("size", f"{size / 1e6:,.1f} MB"),
        ("digest of the arrays", f"`{manifest.digest}`"),
        ("origin", f"`{manifest.recipe_hash}`"),
        ("format version", str(manifest.format_version)),
    )
    opening = snippet('Dataset.open("FOLDER OF THIS CARD")')
    return f"\n# {manifest.id}\n\n{opening}\n" + markdown.table(("", ""), rows)


def _environment(spec: RecordedSpec) -> str:
    rows = [
        (f"`{agent.name}`", describe(agent.observation), str(width(agent.observation)),
         describe(agent.action), str(width(agent.action)))
        for agent in spec.agents
    ]  # fmt: skip
    head = ("agent", "observation", "columns", "action", "columns")
    states = {
        "environment": "the environment's own `state()`",
        "observations": "all observations, one after the other",
    }[spec.state_from]
    horizon = f"at most {spec.horizon} steps" if spec.horizon else "of a length that is not known"
    return (
        "\n## Environment\n\n"
        + markdown.table(head, rows)
        + f"\nStates are {states}: {spec.state_size} numbers. Episodes are {horizon}. Values are "
        "as the environment gave and got them: dictionaries in the order of their sorted keys, "
        "boxes row by row, a discrete choice as its number. Rows of smaller agents are filled with "
        "zeros on the right.\n"
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
    if len(texts) == 1:
        return texts[0]
    shown = texts if len(texts) <= _SHORT else [*texts[: _SHORT - 1], "…"]
    return f"({', '.join(shown)})"


def _arrays(stored: StoredDataset, spec: RecordedSpec) -> str:
    rows = [
        (f"`{name}`", entry.dtype, " x ".join(map(str, entry.shape)))
        for name, entry in sorted(stored.manifest.arrays.items())
    ]
    text = "\n## Arrays\n\n" + markdown.table(("array", "dtype", "shape"), rows)
    text += f"\n{OFFSETS}\n\nArrays with an axis of 0 were not recorded."
    if "alive" in stored.arrays:
        text += (
            " Agents can leave before the team's end: `alive` says who acts next; what agents that "
            "left would have seen, done and got is zero. The last observation of an agent is kept."
        )
    if "action_masks" in stored.arrays:
        text += " `action_masks` says which choices were allowed."
    return f"{text}\n"


def _policies(table: EpisodeTable, origin: Origin) -> str:
    rows = []
    for index in acting(table, origin):
        source, own = origin.policies[index], table.take(np.flatnonzero(table.policy == index))
        rows.append(
            (
                source.label,
                source.name,
                f"{len(own):,}",
                f"{own.lengths.sum():,}",
                f"{own.team_return.mean():.3f} ± {own.team_return.std():.3f}",
                _success(own),
                f"{own.lengths.mean():.1f}",
            )
        )
    head = ("id", "policy", "episodes", "steps", "return", "success", "length")
    return (
        "\n## Behavior policies\n\n"
        + markdown.table(head, rows)
        + "\nReturns are means ± standard deviations over episodes of the sum over time of the "
        "mean reward over agents; lengths are mean joint steps. `external` policies are the "
        "recorder's own.\n"
    )


def _success(table: EpisodeTable) -> str:
    """Share of solved episodes, where the environment ever said whether they were."""
    codes = [END_REASONS.index(reason) for reason in ("success", "failure")]
    return percent(table.success) if np.isin(table.end_reason, codes).any() else "not told"


def _statistics(table: EpisodeTable, origin: Origin, picture: str | None) -> str:
    quantiles = np.quantile(table.team_return, [0.0, 0.25, 0.5, 0.75, 1.0])
    lengths = table.lengths
    rows = [
        ("return, mean", f"{table.team_return.mean():.3f}"),
        ("return, standard deviation", f"{table.team_return.std():.3f}"),
        ("return, min / quartiles / max", " / ".join(f"{value:.2f}" for value in quantiles)),
        ("success", _success(table)),
        ("length, min / mean / max", f"{lengths.min()} / {lengths.mean():.1f} / {lengths.max()}"),
    ]
    for code, reason in enumerate(END_REASONS):
        if (table.end_reason == code).any():
            name = "without a word of success" if reason == "ended" else f"by {reason}"
            rows.append((f"ended {name}", percent(table.end_reason == code)))
    if picture is None:
        text = histogram(table.team_return)
        shown = f"\nTeam return and number of episodes:\n\n```text\n{text}```\n"
    else:
        shown = f"\n![Return and length of episodes, and actions, of {origin.id}]({picture})\n"
    return "\n## Statistics\n\n" + markdown.table(("", "per episode"), rows) + shown


def _checked(table: EpisodeTable, spec: RecordedSpec) -> tuple[Sequence[str], Sequence[str]]:
    """What holds, and what does not, in words."""
    unique = len(np.unique(table.seeds)) == len(table)
    holds = ["Every return is finite."]
    broken: list[str] = []
    (holds if unique else broken).append(
        "No seed of a reset occurs twice." if unique else "Some seeds of resets occur twice."
    )
    if spec.horizon is not None:
        within = bool((table.lengths <= spec.horizon).all())
        (holds if within else broken).append(
            "No episode is longer than the horizon."
            if within
            else "Some episodes are longer than the horizon."
        )
    return holds, broken


def _own_limits(stored: StoredDataset, spec: RecordedSpec) -> list[str]:
    found = []
    if not spec.version:
        found.append("The version of the environment's library is not known.")
    if not stored.arrays["log_probs"].shape[1]:
        found.append("Probabilities of the actions were not recorded.")
    if _success(stored.table) == "not told":
        found.append("The environment did not say whether its task was solved.")
    return found
