"""The table of formats in docs/your-data.md: what an export loses, as the converters say."""

from pathlib import Path

from swarmdata.drawing.markdown import table
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS
from swarmdata.interop.formats import all_formats

PAGE = Path(__file__).parents[1] / "your-data.md"

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

HEAD = ("name", "format", "direction", "an export loses")


def page() -> str:
    """The page, with its table written anew; the words around it are an author's."""
    text = PAGE.read_text(encoding="utf-8")
    rows = []
    for each in all_formats():
        lost = ", ".join(f"`{fact}`" for fact in DATASET_FACTS if fact in each.lost)
        direction = "write" if each.read is None else "both ways"
        rows.append([f"`{each.name}`", each.title, direction, lost or "nothing"])
    before, head, after = text.partition(f"| {' | '.join(HEAD)} |\n")
    if not head:
        raise ValueError(f"{PAGE} has no table of {HEAD}")
    return before + table(HEAD, rows) + after[after.index("\n\n") + 1 :]
