"""The README's table of what each format keeps and loses, from the formats' own tables."""

from swarmdata.drawing import markdown
from swarmdata.interop.conversion.kept_facts import FACTS
from swarmdata.interop.formats import all_formats

MEANINGS = {
    "observations": "observations, the last one included",
    "states": "global states, the last one included",
    "sent": "messages sent",
    "delivered": "messages that arrived",
    "ages": "age of the newest message",
    "alive": "who is still there",
    "action_masks": "allowed actions",
    "actions": "actions",
    "log_probs": "log probabilities of actions",
    "rewards": "rewards of each agent",
    "terminations": "terminations",
    "truncations": "truncations",
    "events": "collisions",
    "agent_terminations": "terminations of each agent",
    "agent_truncations": "truncations of each agent",
    "layout": "obstacles",
    "seed": "seed",
    "policy": "behavior policy",
    "end_reason": "end reason",
    "split": "split",
    "spec": "task or spaces",
}
"""What each of `fields.FACTS` is, for people."""


def table() -> str:
    """Markdown: a row per fact, a column per format that can be written; where it is, or lost."""
    formats = [each for each in all_formats() if each.write is not None]
    head = ["", *(each.title for each in formats)]
    rows = [
        [MEANINGS[fact], *(f"`{f.kept[fact]}`" if fact in f.kept else "lost" for f in formats)]
        for fact in FACTS
    ]
    return markdown.table(head, rows)


def reasons() -> str:
    """Markdown: why a format loses what it loses, a line per format."""
    lines = []
    for each in all_formats():
        whys: dict[str, list[str]] = {}
        for fact, why in each.lost.items():
            whys.setdefault(why, []).append(MEANINGS[fact])
        text = "; ".join(f"{', '.join(facts)}: {why}" for why, facts in whys.items())
        if each.write is not None:
            lines.append(f"- {each.title}: {text or 'nothing is lost'}.\n")
    return "".join(lines)
