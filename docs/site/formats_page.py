"""The tables of docs/formats.md: what each format keeps and loses, as the converters say."""

from pathlib import Path

from swarmdata.drawing.markdown import table
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS
from swarmdata.interop.formats import Format, all_formats

PAGE = Path(__file__).parents[1] / "formats.md"

FACT_TITLES = {
    "observations": "observations, with the last one",
    "states": "global states, with the last one",
    "sent": "messages sent",
    "delivered": "messages delivered",
    "ages": "age of the newest message",
    "alive": "which agents still act",
    "action_masks": "action masks",
    "actions": "actions",
    "log_probs": "log-probabilities of actions",
    "rewards": "rewards of each agent",
    "terminations": "terminations",
    "truncations": "truncations",
    "events": "contacts and collisions",
    "reward_terms": "unweighted terms of the rewards",
    "agent_terminations": "terminations of each agent",
    "agent_truncations": "truncations of each agent",
    "layout": "obstacles",
    "seed": "seed",
    "policy": "behavior policy",
    "end_reason": "end reason",
    "split": "split",
    "spec": "task, or spaces of a recording",
}


def page() -> str:
    """The page, with its tables written anew; the words around them are an author's."""
    text = PAGE.read_text(encoding="utf-8")
    written = list(all_formats())
    names = [
        [f"`{each.name}`", each.title, "write" if each.read is None else "both ways"]
        for each in written
    ]
    kept = [
        [title, *(f"`{each.kept[fact]}`" if fact in each.kept else "lost" for each in written)]
        for fact, title in ((fact, FACT_TITLES[fact]) for fact in DATASET_FACTS)
    ]
    return (
        text[: text.index("| name |")]
        + table(["name", "format", "direction"], names)
        + "\n## What each format keeps\n\nA cell has the name that a format uses.\n\n"
        + table(["", *(each.title for each in written)], kept)
        + "\n## Why something is lost\n\n"
        + "".join(map(_losses, written))
        + text[text.index("\n## Frames\n") :]
    )


def _losses(format: Format) -> str:
    """Why a format loses what it loses: one line."""
    reasons: dict[str, list[str]] = {}
    for fact, reason in format.lost.items():
        reasons.setdefault(reason, []).append(FACT_TITLES[fact])
    lost = "; ".join(f"{', '.join(facts)} ({reason})" for reason, facts in reasons.items())
    return f"- {format.title}: {lost or 'nothing is lost'}.\n"
