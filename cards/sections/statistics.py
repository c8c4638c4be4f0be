"""The sections of a card with statistics: policies, episodes, coverage, log-probabilities."""

from collections.abc import Sequence

import numpy as np

from swarmdata.analysis.coverage import (
    ENTROPY_RESOLUTION,
    MIN_STEPS,
    N_ENCOUNTERS,
    Coverage,
    Entropies,
)
from swarmdata.analysis.passings import ENCOUNTER_DISTANCE, PASSING_DISTANCE
from swarmdata.cards.sections.front_matter import PROPERTIES
from swarmdata.cards.sections.measured_content import CardData
from swarmdata.cards.sections.wording import OWN_NETWORKS_NOTE
from swarmdata.drawing import markdown
from swarmdata.errors import SchemaError
from swarmdata.rollouts.score_statistics import wilson_interval
from swarmdata.specs.recipe import PolicySource
from swarmdata.store import EpisodeTable
from swarmdata.store.arrays.layout import is_checkpoint_file
from swarmdata.store.table import clean_successes
from swarmdata.types import TASK_END_REASONS, Bool, Double

HISTOGRAM_BINS, HISTOGRAM_WIDTH = 12, 40  # rows, and characters of the longest bar

HISTOGRAM_TITLE = "Distribution of the team return, with the number of episodes in each bin:"

_POLICY_HEAD = (
    "id", "policy", "checkpoint", "noise", "episodes", "steps", "return", "success",
    "clean success", "robot collisions", "obstacle collisions", "length",
)  # fmt: skip


def policies_section(data: CardData) -> str:
    """The policies that made the episodes, and how each performed.

    Raises:
        SchemaError: a policy of the recipe made no episode.
    """
    rows = []
    for index, source in enumerate(data.origin.policies):
        chosen = np.flatnonzero(data.table.policy == index)
        if len(chosen):
            rows.append(_policy_row(source, data.table.take(chosen), data.has_events))
        elif data.origin.recipe is not None:  # an edit may have left none of them
            raise SchemaError(f"policy {source.label!r} made no episode of {data.origin.id}")
    has_own = any(map(is_checkpoint_file, data.manifest.files))
    return (
        "\n## Behavior policies\n\n"
        + markdown.table(_POLICY_HEAD, rows)
        + "\nNoise is the standard deviation of the Gaussian noise added to each command. Returns "
        "are means ± standard deviations over episodes, collisions the mean number of contacts "
        "that began in an episode, lengths mean joint steps. A clean success is one without any "
        f"contact.\n{OWN_NETWORKS_NOTE if has_own else ''}"
    )


def _contacts(table: EpisodeTable, *, has_events: bool) -> tuple[str, str, str]:
    """Clean successes, and the mean contacts with robots and with obstacles."""
    if not has_events:
        return ("not recorded",) * 3
    counts = table.robot_collisions, table.obstacle_collisions
    with_robots, with_obstacles = (f"{count.mean():.3f}" for count in counts)
    return percent(clean_successes(table)), with_robots, with_obstacles


def _policy_row(source: PolicySource, table: EpisodeTable, has_events: bool) -> tuple[str, ...]:
    return (
        source.label,
        source.title,
        ", ".join(f"`{each.checkpoint}`" for each in source.acting if each.checkpoint) or "none",
        f"{source.noise:g}",
        f"{len(table):,}",
        f"{table.lengths.sum():,}",
        f"{table.team_return.mean():.2f} ± {table.team_return.std():.2f}",
        percent(table.success),
        *_contacts(table, has_events=has_events),
        f"{table.lengths.mean():.1f}",
    )


def statistics_section(data: CardData, picture: str | None) -> str:
    """All episodes together, with a picture, named by its file, or else a histogram in text."""
    table = data.table
    clean, with_robots, with_obstacles = _contacts(table, has_events=data.has_events)
    rows = [
        ("success", percent(table.success)),
        ("clean success", clean),
        ("length, mean", f"{table.lengths.mean():.1f} steps"),
        ("robot collisions per episode", with_robots),
        ("obstacle collisions per episode", with_obstacles),
    ]
    for side, own in data.sides.items():
        rows.append((f"return of {side}, mean", f"{own.team_return.mean():.3f}"))
        rows.append((f"success of {side}", percent(own.success)))
    for code, reason in enumerate(TASK_END_REASONS):
        rows.append((f"ended by {reason}", percent(table.end_reason == code)))
    shown = "Returns, episode lengths, visited places, commands and four episodes"
    return statistics_text(table.team_return, rows, f"{shown} of {data.origin.id}", picture)


def statistics_text(
    returns: Double, rows: Sequence[tuple[str, str]], shown: str, picture: str | None
) -> str:
    """The section: returns and other rows, and a picture of what is `shown` or a histogram."""
    quantiles = np.quantile(returns, [0.0, 0.25, 0.5, 0.75, 1.0])
    returned = [
        ("return, mean", f"{returns.mean():.3f}"),
        ("return, standard deviation", f"{returns.std():.3f}"),
        ("return, min / quartiles / max", " / ".join(f"{value:.2f}" for value in quantiles)),
    ]
    text = f"![{shown}]({picture})"
    if picture is None:
        text = f"{HISTOGRAM_TITLE}\n\n```text\n{histogram(returns)}```"
    return "\n## Statistics\n\n" + markdown.table(PROPERTIES, [*returned, *rows]) + f"\n{text}\n"


def histogram(values: Double) -> str:
    """Returns a histogram as text, one line per bin."""
    counts, edges = np.histogram(values, bins=HISTOGRAM_BINS)
    scale = HISTOGRAM_WIDTH / counts.max()
    return "".join(
        f"{low:9.2f} … {high:9.2f} |{'█' * round(n * scale):{HISTOGRAM_WIDTH}} {n}\n"
        for n, low, high in zip(counts, edges[:-1], edges[1:], strict=True)
    )


def coverage_section(data: CardData) -> str:
    """How much of the state and action space the data cover."""
    found = data.coverage
    return (
        "\n## Coverage\n\n"
        + markdown.table(("quantity", "measured", "reading"), _coverage_rows(found))
        + f"\nPlaces are counted in {found.n_states:,} states of whole episodes. Entropies are "
        f"nearest-neighbor estimates from {found.n_steps:,} joint steps at a resolution of "
        f"{ENTROPY_RESOLUTION:g} (m, m/s, share of a command): repeated values, such as commands "
        "at a bound, are spread over that width, so the least possible entropy is about "
        f"{np.log(ENTROPY_RESOLUTION):.2f} nats per dimension. In the high-dimensional space of a "
        "team, the entropies of states are overestimated; compare them only between datasets of "
        "the same task. Mutual information and correlation also include common causes, such as the "
        "remaining time.\n" + _passings_table(data)
    )


def _coverage_rows(found: Coverage) -> list[tuple[str, str, str]]:
    places = found.places
    rows = [
        (
            "places visited",
            f"{100 * places.visited:.1f} %",
            f"of the {places.n_free:,} free cells of {places.cell:g} m",
        ),
        ("evenness of the visits", f"{places.entropy:.3f}", "1: all free cells equally often"),
        *_entropy_rows("state", found.states, "position and velocity", "overestimated, see below"),
        *_entropy_rows("command", found.actions, "uniform: 1.39", "uniform: 1.39"),
        ("commands at a bound", f"{100 * found.bounds:.1f} %", "share of all components"),
    ]
    if (known := found.dependence) is not None:
        pairs, both = f"mean over {known.n_pairs} pairs", "of two robots' commands"
        information = f"{known.information:.3f} nats"
        rows += [
            (f"mutual information {both}", information, f"{pairs}; 0: independent"),
            (f"correlation {both}", f"{known.correlation:.3f}", f"{pairs}, absolute value"),
        ]
    reading = "for comparison with other papers; saturates on continuous data"
    return [*rows, ("distinct joint states and actions", f"{100 * found.distinct:.1f} %", reading)]


def _entropy_rows(
    what: str, found: Entropies | None, one: str, team: str
) -> list[tuple[str, str, str]]:
    if found is None:
        return [(f"entropy of a robot's {what}", "unknown", f"needs {MIN_STEPS} joint steps")]
    return [
        (f"entropy of a robot's {what}", f"{found.robot:.2f} nats", one),
        (f"entropy of the team's {what}s", f"{found.team:.2f} nats per robot", team),
    ]


def _passings_table(data: CardData) -> str:
    rows = []
    for index, counts in data.coverage.passings.items():
        if counts.n:
            share = wilson_interval(counts.n_right, counts.n)
            value, low, high = (f"{100 * each:.0f}" for each in share)
            label = data.origin.policies[index].label
            rows.append((label, str(counts.n), f"{value} % [{low}, {high}]"))
    sampled = f"in the sampled episodes, at most {N_ENCOUNTERS} of each policy"
    if not rows:
        return f"\nNo two robots passed each other head-on {sampled}.\n"
    return (
        "\nThe side on which robots pass each other when they meet head-on:\n\n"
        + markdown.table(("id", "passings", "kept to the right"), rows)
        + f"\nCounted {sampled}: two robots come within {ENCOUNTER_DISTANCE:g} m of each other "
        f"with opposing velocities, then within {PASSING_DISTANCE:g} m, and separate behind each "
        "other. Brackets are 95 % Wilson intervals.\n"
    )


def log_probs_section(data: CardData) -> str:
    """Log-probabilities of the actions under their policies; empty where they were not recorded."""
    if data.log_probs is None:
        return ""
    rows = []
    for index, each in data.log_probs.items():
        values = (each.mean, *each.quantiles)
        shown = (f"{value:.2f}" if np.isfinite(value) else "none" for value in values)
        label = data.origin.policies[index].label
        rows.append((label, *shown, f"{100 * each.undefined:.1f} %"))
    return (
        "\n## Log-probabilities of the actions\n\n"
        + markdown.table(("id", "mean", "1 %", "median", "99 %", "undefined"), rows)
        + "\nMean and quantiles of `log_probs`, in nats per robot and step, under the policy that "
        "acted, noise included. A policy with 0 throughout is deterministic. Undefined values are "
        "those that are not finite.\n"
    )


def percent(values: Bool) -> str:
    """A share of episodes."""
    return f"{100 * values.mean():.1f} %"
