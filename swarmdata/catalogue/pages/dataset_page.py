"""The page of one dataset: task, replay, how to get it, best results, reward, arrays, episodes."""

import re
from collections.abc import Sequence
from typing import Any
from urllib.parse import urlencode

from markdown_it import MarkdownIt
from markdown_it.renderer import RendererHTML
from markdown_it.token import Token

from swarmdata.catalogue.boards import Board
from swarmdata.catalogue.drawings import svg_shapes
from swarmdata.catalogue.elements import Html, element, join, section
from swarmdata.catalogue.entries import Entry, in_sizes
from swarmdata.catalogue.pages.figures_shown import compact, count, percent
from swarmdata.catalogue.pages.getting import get_part
from swarmdata.catalogue.pages.page_frame import Page
from swarmdata.catalogue.pages.results_tables import (
    about,
    brief_table,
    entry_lines,
    family_key,
    series_of,
)
from swarmdata.catalogue.pages.task_facts import arrays_part, lead, reward_part
from swarmdata.catalogue.pages.viewer_parts import episode_table, series_viewer, world_viewer
from swarmdata.specs.model_choice import is_same_world
from swarmdata.specs.origins import Spec

COLUMNS = {
    "index": "episode",
    "policy": "policy",
    "end": "outcome",
    "return": "return",
    "length": "steps",
    "collisions": "collisions",
    "split": "split",
}
"""Columns of the table of episodes: key and head."""

MOST_BASELINES = 12  # results on a dataset's page; the results page has all

TABLE_SCRIPTS = ("core.js", "data.js", "histograms.js", "episode_table.js")
VIEWER_SCRIPTS = (*TABLE_SCRIPTS, "link.js", "player.js", "viewer.js")
WORLD_SCRIPTS = (
    *VIEWER_SCRIPTS,
    *("replay.js", "rays.js", "pen.js", "marks.js", "robots.js", "signals.js", "view.js"),
    *("track.js", "events.js", "world_page.js"),
)
SERIES_SCRIPTS = (*VIEWER_SCRIPTS, "lines.js", "pictures.js", "series_page.js")

_FRONT_MATTER = re.compile(r"\A---\n.*?\n---\n", re.DOTALL)

_LINK = re.compile(r"https?://|(?![\w+.-]*:)")
"""Targets of links: web addresses, and what is relative."""


def dataset_page(
    entry: Entry,
    spec: Spec,
    n_shown: int,
    picture: Html,
    entries: Sequence[Entry],
    results: Sequence[Board],
) -> Page:
    """Returns the page of a dataset, of which `n_shown` episodes are shown through a spec's models.

    Entries of its task are linked, and shown beside it.
    """
    is_world = spec.world is not None
    scripts: tuple[str, ...] = ("core.js", "ready.js")
    viewer, browser = _absent(entry, picture), join()
    if n_shown:
        scripts = WORLD_SCRIPTS if is_world else SERIES_SCRIPTS
        viewer = series_viewer()
        if spec.world is not None and entry.spec.world is not None:
            viewer = world_viewer(spec.world, entry.spec.world)
        columns = {k: head for k, head in COLUMNS.items() if is_world or k != "collisions"}
        choices = {"policy": "Policy", "split": "Split"}
        browser = episode_table(columns, _sample(entry, n_shown), choices)
    reward = "" if entry.reward_spec is None else reward_part(entry.reward_spec)
    body = join(
        element("p", element("a", "‹ All datasets", href="../index.html"), class_="crumbs"),
        element("div", element("h1", entry.id), _sizes(entry, entries), class_="top"),
        element("p", lead(entry), class_="lead"),
        _tiers(entry, entries),
        element("div", viewer, get_part(entry, spec), _baselines(entry, results), class_="dataset"),
        element("div", reward, arrays_part(entry), class_="halves"),
        browser,
        _card(entry),
    )
    peers = [other.id for other in entries if _is_peer(entry, other)]
    data = {"key": entry.id, "peers": peers, "root": "../"}
    return Page(f"datasets/{entry.id}.html", f"{entry.id}: swarmdata", body, scripts, data)


def _is_peer(entry: Entry, other: Entry) -> bool:
    """Whether both have episodes, in the same world or of the same environment."""
    if other is entry or entry.dataset is None or other.dataset is None:
        return False
    one, two = entry.spec, other.spec
    if one.world is None or two.world is None:
        return one.hash() == two.hash()
    return is_same_world(one.world, two.world)


def _sizes(entry: Entry, entries: Sequence[Entry]) -> Html:
    """The switch between the full dataset and its mini, where the catalogue has both."""
    sizes = [each for each in entries if each.full_id == entry.full_id]
    sizes.sort(key=lambda each: each.is_mini)
    texts = [(f"{'Mini' if e.is_mini else 'Full'} · {compact(e.n_steps)} steps",) for e in sizes]
    return _switch(entry, sizes, texts, class_="sizes", aria_label="Size")


def _tiers(entry: Entry, entries: Sequence[Entry]) -> Html:
    """The other tiers of the same task beside it, by the share of solved episodes."""
    same = [each for each in entries if each.spec.hash() == entry.spec.hash()]
    tiers = [
        next((s for s in sizes if s.is_mini == entry.is_mini), sizes[0]) for sizes in in_sizes(same)
    ]
    tiers.sort(key=lambda each: (each.success or 0.0, each.id))
    are_told_apart = len({each.origin.tier for each in tiers}) == len(tiers)
    texts = [
        (element("b", each.origin.tier if are_told_apart else each.id), *_solved(each))
        for each in tiers
    ]
    return _switch(entry, tiers, texts, class_="tiers", aria_label="Tiers of this task")


def _switch(
    entry: Entry, choices: Sequence[Entry], texts: Sequence[tuple[object, ...]], **attributes: str
) -> Html:
    """Links to datasets beside this one; empty where there is no other."""
    if len(choices) < 2:
        return join()
    links = [
        element("a", *text, href=f"{e.id}.html", aria_current="page" if e is entry else None)
        for e, text in zip(choices, texts, strict=True)
    ]
    return element("nav", *links, **attributes)


def _solved(entry: Entry) -> tuple[object, ...]:
    """The share of solved episodes, where it is known, as text and as a bar."""
    if entry.success is None:
        return ()
    return f"{percent(entry.success)} {entry.solved}", svg_shapes.share_bar(entry.success)


def _absent(entry: Entry, picture: Html) -> Html:
    text = join(
        "The episodes are not in this catalogue. ",
        element("code", f"swarmdata catalogue build {entry.id}"),
        " makes one with its replays.",
    )
    return element("div", picture, element("p", text, class_="absent"), class_="still")


def _sample(entry: Entry, n_shown: int) -> str:
    """How many of the episodes are shown."""
    if n_shown == entry.n_episodes:
        return f"All {count(n_shown, 'episode')} of the dataset."
    return (
        f"{n_shown:,} of {entry.n_episodes:,} episodes: every policy and outcome has its share, "
        "evenly spaced."
    )


def _baselines(entry: Entry, results: Sequence[Board]) -> Html:
    """The best algorithms at one budget; beside a mini without results, on the full dataset."""
    title = "Offline algorithms, best first"
    found = [board for board in results if board.name in (entry.id, entry.full_id)]
    if not found:
        text = element("p", "This catalogue has no results on it.", class_="note")
        return section(title, "results", text)
    board = max(found, key=lambda each: (each.name == entry.id, each.dataset == each.name))
    rows = (board.of("algorithms") or list(board.rows))[:MOST_BASELINES]
    families = sorted({row.outcome.family for row in rows})
    series = series_of(results)
    address = f"../results.html#{urlencode({'dataset': board.dataset, 'group': 'all'})}"
    where = "" if board.name == entry.id else f"On the full dataset, {board.name}. "
    if board.dataset != board.name:
        where += f"These are of {board.dataset}. "
    return section(
        title,
        "results",
        element("p", f"{where}{about(board)}", class_="note"),
        brief_table(board, rows, series, "../"),
        *entry_lines(board),
        family_key(families, series),
        element("p", element("a", f"All {len(board.rows)} results", href=address)),
    )


def _card(entry: Entry) -> Html:
    if entry.card is None:
        command = element("code", f"swarmdata card {entry.id} --write")
        return section("Card", "card", element("p", "This dataset has no card yet: ", command))
    inside = element("details", element("summary", "The whole card"), card_html(entry.card))
    return section("Card", "card", inside, class_="card-text")


def card_html(text: str) -> Html:
    """Returns a card without its front matter, title and picture, headings one level deeper.

    It is CommonMark with tables, from which nothing becomes HTML of its own.
    """
    parser = _Parser("commonmark", {"html": False}, renderer_cls=_Renderer).enable("table")
    tokens = parser.parse(_FRONT_MATTER.sub("", text))
    left_out: set[int] = set()
    for k in range(1, len(tokens)):
        if _is_left_out(tokens[k - 1], tokens[k]):
            left_out |= {k - 1, k, k + 1}
    shown = [token for k, token in enumerate(tokens) if k not in left_out]
    return Html(parser.renderer.render(shown, parser.options, {}))


def _is_left_out(before: Token, token: Token) -> bool:
    """Whether this is the text of the title, or of a paragraph with nothing but a picture."""
    if before.type == "paragraph_open":
        return all(each.type == "image" for each in token.children or ())
    return before.type == "heading_open" and before.tag == "h1"


class _Parser(MarkdownIt):
    def validateLink(self, url: str) -> bool:  # noqa: N802  (the library's name)
        return _LINK.match(url) is not None


class _Renderer(RendererHTML):
    """What pages have besides: scrolled code and tables, and a first cell that names its row."""

    def heading_open(self, tokens: Sequence[Token], idx: int, *rest: Any) -> str:
        tokens[idx].tag = f"h{min(6, int(tokens[idx].tag[1:]) + 1)}"
        return self.renderToken(tokens, idx, *rest)

    heading_close = heading_open

    def fence(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return element("pre", element("code", tokens[idx].content.rstrip("\n")), tabindex="0")

    def code_block(self, *parts: Any) -> str:
        return self.fence(*parts)

    def image(self, *_: Any) -> str:
        return ""

    def link_open(self, tokens: Sequence[Token], idx: int, *rest: Any) -> str:
        tokens[idx].attrSet("rel", "noopener")
        return self.renderToken(tokens, idx, *rest)

    def table_open(self, *_: Any) -> str:
        return '<div class="wide"><table>'

    def table_close(self, *_: Any) -> str:
        return "</table></div>"

    def th_open(self, *_: Any) -> str:  # without its style, which pages do not allow
        return '<th scope="col">'

    def td_open(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return '<th scope="row">' if tokens[idx - 1].type == "tr_open" else "<td>"

    def td_close(self, tokens: Sequence[Token], idx: int, *_: Any) -> str:
        return "</th>" if tokens[idx - 3].type == "tr_open" else "</td>"
