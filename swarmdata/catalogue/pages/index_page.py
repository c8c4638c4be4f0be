"""The index: a card for each dataset, with what they are sorted and filtered by."""

from collections.abc import Sequence

from swarmdata.catalogue.elements import Html, element, join
from swarmdata.catalogue.entries import Entry, is_mini_id
from swarmdata.catalogue.pages.figures_shown import compact, count, megabytes, percent, score
from swarmdata.catalogue.pages.page_frame import Page

SORTS = (
    ("shown", "replays first"),
    ("name", "name"),
    ("success", "success"),
    ("score", "score"),
    ("steps", "size"),
    ("team", "team"),
)
"""Orders: attribute of the cards, from high to low but for names, and label."""


def index_page(entries: Sequence[Entry], pictures: dict[str, Html]) -> Page:
    """Returns the index of a catalogue.

    Args:
        entries: in the order of their ids.
        pictures: drawing of each dataset, by id.
    """
    n_shown = sum(entry.dataset is not None for entry in entries)
    intro = element(
        "p",
        f"{count(len(entries), 'dataset')}. {n_shown:,} of them with episodes to replay.",
        class_="lead",
    )
    cards = [_card(entry, pictures.get(entry.id, join())) for entry in entries]
    body = join(
        element("h1", "Datasets"),
        intro,
        _filters(entries),
        element("p", count(len(entries), "dataset"), id="shown", role="status"),
        element("ul", *cards, id="cards", class_="cards"),
    )
    return Page("index.html", "swarmdata: datasets", body, ("core.js", "listing.js"), {})


def _filters(entries: Sequence[Entry]) -> Html:
    """The form above the cards; its fields are named after attributes of the cards."""
    teams = sorted({entry.spec.n_agents for entry in entries})
    search = element("input", type="search", name="search", placeholder="name, task or tier")
    sorts = [element("option", label, value=name) for name, label in SORTS]
    fields = (
        element("label", "Search", search),
        _choice("Task", "task", sorted({entry.spec.task for entry in entries})),
        _choice("Tier", "tier", sorted({entry.tier for entry in entries})),
        _choice("Robots", "team", [str(team) for team in teams]),
        _choice("Size", "size", ["mini", "full"]),
        _choice("Made by", "kind", sorted({entry.kind for entry in entries})),
        element("label", "Sort by", element("select", *sorts, name="sort")),
        element(
            "label",
            element("input", type="checkbox", name="replays"),
            " with replays only",
            class_="check",
        ),
        element("button", "Clear", type="reset"),
    )
    return element("form", *fields, id="filters", role="search", aria_label="Filter datasets")


def _choice(label: str, name: str, values: Sequence[str]) -> Html:
    options = [element("option", "all", value="")]
    options += [element("option", value, value=value) for value in values]
    return element("label", label, element("select", *options, name=name))


def _card(entry: Entry, picture: Html) -> Html:
    is_mini = is_mini_id(entry.id)
    facts = [
        ("robots", str(entry.spec.n_agents)),
        ("success", percent(entry.success)),
        ("score", score(entry.score)),
        ("episodes", "–" if entry.n_episodes is None else f"{entry.n_episodes:,}"),
        ("joint steps", compact(entry.n_steps)),
        ("size", megabytes(entry.n_bytes)),
    ]
    figures = [element("div", element("dt", name), element("dd", value)) for name, value in facts]
    link = element("a", entry.id, href=f"datasets/{entry.key}.html")
    inside = (
        element("div", picture, class_="picture"),
        element("h2", link),
        _tags(entry),
        element("dl", *figures),
    )
    return element(
        "li",
        *inside,
        class_="card",
        data_name=entry.id,
        data_task=entry.spec.task,
        data_tier=entry.tier,
        data_team=entry.spec.n_agents,
        data_size="mini" if is_mini else "full",
        data_kind=entry.kind,
        data_steps=entry.n_steps,
        data_success="" if entry.success is None else f"{entry.success:.6g}",
        data_score="" if entry.score is None else f"{entry.score:.6g}",
        data_replays="yes" if entry.dataset is not None else "no",
        data_shown=int(entry.dataset is not None),
    )


def _tags(entry: Entry) -> Html:
    tags = [
        element("span", entry.spec.task, class_="tag task"),
        element("span", entry.tier, class_="tag"),
    ]
    if entry.kind == "recorded" and entry.tier != "recorded":
        tags.append(element("span", "recorded", class_="tag"))
    if entry.dataset is not None:
        tags.append(element("span", "▶ replays", class_="tag replays"))
    return element("p", *tags, class_="tags")
