"""How to get a dataset, and what one wants to know before: size, costs, license, digest."""

import shlex

import numpy as np

from swarmdata import __version__
from swarmdata.cards.references import LESS_COORDINATED
from swarmdata.catalogue.elements import Html, element, join, section
from swarmdata.catalogue.entries import Entry
from swarmdata.catalogue.pages.figures_shown import UNKNOWN, file_size, percent, score
from swarmdata.errors import SchemaError
from swarmdata.registry.published import license_of
from swarmdata.runtime.cache_folder import cache_folder
from swarmdata.specs.action_scaling import action_scale, has_choices
from swarmdata.specs.model_choice import describe
from swarmdata.specs.origins import Spec
from swarmdata.specs.rules import rules_model

DIGITS = 12  # of a digest in print

MOST_NAMES = 4  # policies that are named; the card has all


def get_part(entry: Entry, spec: Spec) -> Html:
    """Lines to copy, and the facts of a dataset, which is shown through the spec's models."""
    name = _name_to_load(entry)
    models = ""
    if spec != entry.spec and spec.world is not None:
        models = "  # replayed here through other sensors or radios: see dataset.reobserve"
    codes = {
        "install": "pip install swarmdata",
        "python": f'import swarmdata\ndata = swarmdata.load("{name}"){models}',
    }
    if _is_learned(entry):
        codes["install"] = "pip install 'swarmdata[torch]'"
        world = entry.spec.world
        sides = world.sides if world is not None and len(world.sides) > 1 else ()
        side = f" --side {sides[0].name}" if sides else ""
        codes["shell"] = f"swarmdata train bc {shlex.quote(name)}{side} --out runs/bc"
    snippets = (_snippet(key, text) for key, text in codes.items())
    return section("Get it", "load", *snippets, _facts(entry))


def _snippet(key: str, text: str) -> Html:
    code = element("pre", element("code", text, id=f"copy-{key}"), tabindex="0")
    return element("div", code, _copy(key, f"Copy {key} code"), class_="snippet")


def _copy(key: str, label: str) -> Html:
    return element("button", "Copy", type="button", data_copies=f"copy-{key}", aria_label=label)


def _facts(entry: Entry) -> Html:
    episodes = UNKNOWN if entry.n_episodes is None else f"{entry.n_episodes:,}"
    size = f"{file_size(entry.n_bytes)}, {episodes} episodes, {entry.n_steps:,} joint steps"
    license = license_of(entry.origin)
    facts: list[tuple[str, object]] = [
        ("size", size + ("; the first 5 % of the full dataset" if entry.is_mini else "")),
        ("address", _address(entry)),
        ("source", entry.kind),
        ("recorded by", _policies(entry)),
        (entry.solved, _solved(entry)),
        ("score", UNKNOWN if entry.score is None else f"{score(entry.score)} (100: expert)"),
        ("costs", _costs(entry)),
        ("messages", _messages(entry)),
        ("coordination gap", _gap(entry)),
        ("license", "not stated" if license == "unknown" else license),
        ("digest", UNKNOWN if entry.digest is None else _digest(entry.digest)),
        ("cite as", _citation(entry)),
    ]
    rows = [join(element("dt", name), element("dd", value)) for name, value in facts]
    return element("dl", *rows, class_="facts")


def _solved(entry: Entry) -> str:
    if entry.clean_success is None:
        return percent(entry.success)
    return f"{percent(entry.success)}, {percent(entry.clean_success)} without a contact"


def _address(entry: Entry) -> object:
    dataset = entry.dataset
    if dataset is not None and dataset.source not in ("cache", "rebuilt", "folder"):
        return element("code", dataset.source)
    if dataset is not None and not dataset.recipe.can_rebuild:
        return "a folder; no recipe rebuilds it"
    return join("none: ", element("code", "load"), " rebuilds it from its recipe, bit for bit")


def _policies(entry: Entry) -> str:
    policies = entry.origin.policies
    names = ", ".join(policy.label for policy in policies[:MOST_NAMES])
    more = ", …" if len(policies) > MOST_NAMES else ""
    return names if len(policies) <= 1 else f"{len(policies)} policies: {names}{more}"


def _costs(entry: Entry) -> str:
    if entry.collisions is None:
        return "not recorded"
    robots, obstacles = entry.collisions
    return f"{robots:.2f} collisions with robots, {obstacles:.2f} with obstacles an episode"


def _messages(entry: Entry) -> str:
    world = entry.spec.world
    if world is None:
        return UNKNOWN
    if not entry.has_messages:
        return "none; dataset.reobserve adds a radio"
    return describe(world).partition(", communication ")[2]


def _gap(entry: Entry) -> object:
    """By how much the scripted team is better than less coordinated ones."""
    if not entry.gaps:
        return "not measured"
    meanings, items = {**LESS_COORDINATED, **rules_model(entry.spec.task).naive_teams}, []
    for name, gaps in entry.gaps.items():
        points, clean = (f"{100 * gaps[key].value:.1f}" for key in ("success", "clean_success"))
        text = f"{points} points of success, {clean} of clean success: {meanings[name]}"
        items.append(element("div", text))
    return join(*items)


def _digest(digest: str) -> Html:
    short = element("code", f"{digest[:DIGITS]}…", title=digest)
    whole = element("span", digest, id="copy-digest", hidden=True)
    return join(short, whole, " ", _copy("digest", "Copy the whole digest"))


def _citation(entry: Entry) -> Html:
    digest = "" if entry.digest is None else f"digest {entry.digest[:DIGITS]}, "
    text = f"{entry.id} ({digest}swarmdata {__version__})"
    return join(element("span", text, id="copy-citation"), " ", _copy("citation", "Copy citation"))


def _name_to_load(entry: Entry) -> str:
    """What `load` takes: the id of a published or cached dataset, else an address or a folder.

    Of a folder, its place is not told: it is named as from the folder above it.
    """
    dataset = entry.dataset
    is_cached = dataset is not None and dataset.path == cache_folder() / "datasets" / entry.id
    if dataset is None or is_cached or dataset.source in ("cache", "rebuilt"):
        return entry.id
    return f"./{dataset.path.resolve().name}" if dataset.source == "folder" else dataset.source


def _is_learned(entry: Entry) -> bool:
    """Whether algorithms learn from it: images and actions without bounds are for other code."""
    if entry.dataset is None or entry.spec.world is not None:
        return True
    if entry.dataset.recipe.missing is not None or entry.dataset[0].observations.dtype == np.uint8:
        return False
    try:
        return bool(has_choices(entry.spec)) or bool(action_scale(entry.spec))
    except SchemaError:
        return False
