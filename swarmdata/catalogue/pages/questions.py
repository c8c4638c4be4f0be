"""The table of questions on the front page, which is that of docs/which-dataset.md."""

from collections.abc import Mapping

from swarmdata.catalogue.elements import Html, element, join, table
from swarmdata.catalogue.entries import Entry
from swarmdata.catalogue.pages.figures_shown import percent
from swarmdata.registry.recipes import NEWEST_VERSION

QUESTIONS = (
    ("learn at all?", ("coop_nav-expert",), "behavior cloning is as good as the data"),
    (
        "improve on the data?",
        ("coop_nav-medium-replay", "coop_nav-medium"),
        "the data contain better actions to find",
    ),
    ("choose among policies?", ("coop_nav-medium-expert",), "half of the steps are by experts"),
    (
        "stay close to narrow data?",
        ("coop_nav-narrow",),
        "one expert with little noise; the value of other actions cannot be estimated",
    ),
    (
        "agree on a convention?",
        ("coop_nav-ranks-two-conventions", "coop_nav-lanes-two-conventions"),
        "robots that imitate the mixture separately fail",
    ),
    ("cope with mixed conventions?", ("coop_nav-mixed-conventions",), "half keep right, half left"),
    ("learn without any success?", ("coop_nav-random",), "only the reward says what is good"),
    ("scale with the team?", ("coop_nav-n8-medium", "formation-n8-medium"), "eight robots"),
    (
        "generalize beyond navigation?",
        ("transport-medium", "warehouse-medium", "formation-medium"),
        "pushing, oncoming traffic and moving slots",
    ),
    (
        "learn to avoid contacts?",
        ("coop_nav-scripted",),
        "nearly all episodes are solved without a contact",
    ),
)
"""What is asked of an algorithm, the datasets that answer it, without versions, and why."""


def questions_table(entries: Mapping[str, Entry]) -> Html:
    """Returns the questions that the datasets of a catalogue answer; empty if they answer none.

    Args:
        entries: of the catalogue, by id.
    """
    rows: list[tuple[object, ...]] = []
    for question, names, why in QUESTIONS:
        found = [entries[key] for name in names if (key := f"{name}-v{NEWEST_VERSION}") in entries]
        links = [_link(entry) for entry in found]
        if links:
            rows.append((question, join(*links), why))
    if not rows:
        return join()
    head = ("Does my algorithm …", "use (solved)", "because")
    return element("section", table(head, rows, class_="questions"), aria_label="Which dataset?")


def _link(entry: Entry) -> Html:
    link = element("a", entry.id, href=f"datasets/{entry.key}.html")
    return element("span", link, f" {percent(entry.success)}")
