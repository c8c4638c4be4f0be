"""The index: what this is, which dataset answers which question, and a card for each dataset."""

from collections.abc import Mapping, Sequence

from swarmdata.catalogue.elements import Html, element, join, table
from swarmdata.catalogue.entries import Entry, in_sizes
from swarmdata.catalogue.pages.figures_shown import UNKNOWN, file_size, per_episode, percent, score
from swarmdata.catalogue.pages.filters import choice, form, nothing_found
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.registry.tiers import NEWEST_VERSION

SCRIPTS = ("core.js", "filters.js", "sorting.js", "listing.js")

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
    (
        "scale with the team?",
        ("coop_nav-n8-medium", "formation-n8-medium", "coop_nav-n16-medium"),
        "eight and sixteen robots",
    ),
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
    (
        "cope with robots of several kinds?",
        ("coop_nav-mixed-medium", "coop_nav-mixed-expert"),
        "scouts, a rover that cannot move sideways and a slow carrier",
    ),
    (
        "drive differential robots?",
        ("robotarium-medium", "robotarium-expert"),
        "the speeds, sizes and rules of a public testbed",
    ),
    (
        "need a team?",
        ("pursuit-medium-replay", "coop_nav-corridor-strict-medium-expert", "search-strict-expert"),
        "robots that ignore each other solve nothing",
    ),
    (
        "play against others?",
        ("tag-medium-replay", "tag-expert"),
        "three pursuers and an evader, with learned policies on both sides",
    ),
    (
        "learn to use messages?",
        ("search-lift-expert", "search-lift-medium-expert"),
        "without messages, robots seldom agree on the next victim",
    ),
)
"""What is asked, the datasets that answer it, and why, as docs/which-dataset.md says at length."""

SORTS = {
    "shown": "replays first",
    "name": "name",
    "success": "success",
    "score": "score",
    "gap": "need for others",
    "steps": "size",
    "team": "team",
}
"""Orders: attribute of the cards, from high to low but for names, and label."""

LARGE_GAP = 50.0  # points of clean success from which robots need each other

NEEDS = {
    "large": f"large (gap {LARGE_GAP:.0f} or more)",
    "small": f"small (gap below {LARGE_GAP:.0f})",
    "unknown": "not measured",
}

Sizes = Sequence[Entry]  # a dataset in its sizes, the full one first


def index_page(entries: Sequence[Entry], pictures: Mapping[str, Html]) -> Page:
    """Returns the index of a catalogue."""
    found = in_sizes(entries)
    cards = [_card(sizes, pictures) for sizes in found]
    body = join(
        element("h1", "Offline datasets of robot teams"),
        _opening(),
        _questions({entry.id: entry for entry in entries}),
        _filters(found),
        *nothing_found("datasets"),
        element("ul", *cards, id="cards", class_="cards"),
        element("button", "Show all", type="button", class_="more", hidden=True),
        _table(found),
    )
    return Page("index.html", "swarmdata: datasets", body, SCRIPTS, {})


def _opening() -> Html:
    return element(
        "p",
        "Recorded episodes of teams of robots, to learn policies from without a simulator, with "
        "the tasks to evaluate them in. A tier names the policies that recorded a dataset; a "
        "score is a mean return on a scale from 0, the better of an idle and a random team, to "
        "100, the expert. ",
        element("code", "pip install swarmdata"),
        " installs it, and ",
        element("code", 'swarmdata.load("coop_nav-medium-mini")'),
        " loads a first dataset or rebuilds it without any server.",
        class_="lead",
    )


def _questions(entries: Mapping[str, Entry]) -> Html:
    """The questions that the datasets of a catalogue answer; empty if they answer none."""
    rows: list[tuple[object, ...]] = []
    for question, names, why in QUESTIONS:
        found = [entries[key] for name in names if (key := f"{name}-v{NEWEST_VERSION}") in entries]
        links = [
            element("span", _link(entry, entry.id), f" {percent(entry.success)}") for entry in found
        ]
        if links:
            rows.append((question, join(*links), why))
    if not rows:
        return join()
    head = ("Does my algorithm …", "use (solved)", "because")
    return element("section", table(head, rows, class_="questions"), aria_label="Which dataset?")


def _link(entry: Entry, text: str) -> Html:
    return element("a", text, href=f"datasets/{entry.id}.html")


def _filters(found: Sequence[Sizes]) -> Html:
    """The form above the cards; its fields are named after attributes of the cards."""
    firsts = [sizes[0] for sizes in found]
    teams = [str(team) for team in sorted({entry.spec.n_agents for entry in firsts})]
    search = element("input", type="search", name="search", placeholder="name, task or tier")
    replays = element("input", type="checkbox", name="replays")
    return form(
        "Filter datasets",
        (
            element("label", "Search", search),
            choice("Task", "task", sorted({entry.spec.task for entry in firsts})),
            choice("Tier", "tier", sorted({entry.origin.tier for entry in firsts})),
            choice("Robots", "team", teams),
            choice("Need for others", "need", labels=NEEDS),
            choice("Messages", "messages", ["yes", "no"]),
            choice("Costs", "costs", ["yes", "no"]),
            choice("Source", "kind", sorted({entry.kind for entry in firsts})),
            choice("Sort by", "sort", labels=SORTS, default="shown", every=None),
            choice("Show as", "view", ["cards", "table"], default="cards", every=None),
            element("label", replays, " replays", class_="check"),
        ),
    )


def _card(sizes: Sizes, pictures: Mapping[str, Html]) -> Html:
    entry, shown = sizes[0], [each for each in sizes if each.dataset is not None]
    need = "unknown"
    if entry.need is not None:
        need = "large" if entry.need >= LARGE_GAP else "small"
    picture = pictures.get((shown or sizes)[0].id, join())
    facts = [
        ("robots" if entry.spec.world else "agents", str(entry.spec.n_agents)),
        ("solved", percent(entry.success)),
        ("score", score(entry.score)),
        ("gap", UNKNOWN if entry.need is None else f"{entry.need:.0f}"),
        ("messages", "yes" if entry.has_messages else "no"),
        ("collisions", per_episode(entry.collisions)),
    ]
    figures = [element("div", element("dt", name), element("dd", value)) for name, value in facts]
    links = [_size_link(each) for each in sizes]
    return element(
        "li",
        element("div", picture, class_="picture"),
        element("h2", _link(entry, entry.full_id)),
        element("dl", *figures),
        element("div", *links, class_="sizes", role="group", aria_label="Sizes"),
        class_="card",
        data_name=entry.full_id,
        data_task=entry.spec.task,
        data_tier=entry.origin.tier,
        data_team=entry.spec.n_agents,
        data_need=need,
        data_gap=_plain(entry.need),
        data_messages="yes" if entry.has_messages else "no",
        data_costs="no" if entry.collisions is None else "yes",
        data_kind=entry.kind,
        data_steps=entry.n_steps,
        data_success=_plain(entry.success),
        data_score=_plain(entry.score),
        data_replays="yes" if shown else "no",
        data_shown=len(shown),
    )


def _plain(value: float | None) -> str:
    return "" if value is None else f"{value:.6g}"


def _size_link(entry: Entry) -> Html:
    """A link to one size, marked where its episodes can be replayed."""
    name = "mini" if entry.is_mini else "full"
    mark = "▶ " if entry.dataset is not None else ""
    size = element("small", file_size(entry.n_bytes))
    return element(
        "a",
        f"{mark}{name}",
        size,
        href=f"datasets/{entry.id}.html",
        aria_label=f"{entry.id}{', with replays' if mark else ''}",
    )


NUMBERS = ("robots", "solved (%)", "clean (%)", "score", "gap", "collisions")
HEADS = ("dataset", "task", "tier", *NUMBERS, "messages", "source", "size")  # columns of the table


def _table(found: Sequence[Sizes]) -> Html:
    """The same datasets as a table, which is sorted by a click on its heads."""
    head = [
        element("th", name, scope="col", class_="n" if name in NUMBERS else None) for name in HEADS
    ]
    body = element("tbody", *(_row(each) for each in found))
    rows = element("table", element("thead", element("tr", *head)), body, class_="sortable")
    return element(
        "div", rows, id="table", class_="wide", hidden=True, tabindex="0", role="region",
        aria_label="Datasets",
    )  # fmt: skip


def _row(sizes: Sizes) -> Html:
    entry = sizes[0]
    links = [_size_link(each) for each in sizes]
    return element(
        "tr",
        element("th", _link(entry, entry.full_id), scope="row"),
        element("td", entry.spec.task),
        element("td", entry.origin.tier),
        _number(float(entry.spec.n_agents), 0),
        _number(entry.success and 100 * entry.success, 1),
        _number(entry.clean_success and 100 * entry.clean_success, 1),
        _number(entry.score, 1),
        _number(entry.need, 1),
        _number(entry.collisions and sum(entry.collisions), 2),
        element("td", "yes" if entry.has_messages else "no"),
        element("td", entry.kind),
        element("td", element("div", *links, class_="sizes")),
        data_name=entry.full_id,
    )


def _number(value: float | None, decimals: int) -> Html:
    text = UNKNOWN if value is None else f"{value:.{decimals}f}"
    return element("td", text, class_="n", data_value="-1e9" if value is None else f"{value:.8g}")
