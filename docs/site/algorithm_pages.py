"""Pages of algorithms: docstring, settings and losses of each."""

import dataclasses
from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any

from docs.site.ablations import ABLATIONS
from docs.site.docstrings import field_notes, markdown_of, summary_of
from swarmdata.drawing.markdown import table
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS, resolve


def algorithm_pages() -> dict[str, str]:
    """A page for each algorithm, offline and online, and their index."""
    pages = {}
    text = (
        "# Algorithms, one by one\n\nMaths, sources, deviations and settings of each. The guides "
        "to [offline](../../docs/learning.md) and [online learning](../../docs/online-learning.md) "
        "say which to try, [Settings](../../docs/settings.md) where each default comes from.\n"
    )
    for title, known, prefix, command in (
        ("offline", OFFLINE_ALGORITHMS, "", "train {0} coop_nav-medium"),
        ("online", ONLINE_ALGORITHMS, "online-", "train-online {0} coop_nav"),
    ):
        rows = []
        for name in known:
            head = f"    swarmdata {command.format(name)} --out runs/{name}\n"
            without = _ablation(name) if title == "offline" else ""
            algorithm = resolve("algorithm", known, name)
            about = import_module(known[name].partition(":")[0]).__doc__
            pages[f"reference/algorithms/{prefix}{name}.md"] = _page(
                f"`{name}`, {title}", head + without, algorithm, about
            )
            rows.append([f"[`{name}`]({prefix}{name}.md)", summary_of(about)])
        text += f"\n## {title.capitalize()}\n\n{table(('algorithm', 'what it does'), rows)}"
    pages["reference/algorithms/index.md"] = text
    return pages


def _ablation(name: str) -> str:
    if (ablation := ABLATIONS.get(name)) is None:
        return ""
    changed = "".join(f" --set {key}={value}" for key, value in ablation.settings.items())
    return (
        f"\nIts ablation, in studies `{name}-without`, lacks {ablation.ingredient}:\n\n"
        f"    swarmdata train {ablation.algorithm or name} coop_nav-medium{changed}\n"
    )


def settings(config: Any, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    """Name, default and comment of every setting of a configuration, sections flattened."""
    notes = field_notes(type(config))
    for field in dataclasses.fields(config):
        value, name = getattr(config, field.name), f"{prefix}{field.name}"
        if dataclasses.is_dataclass(value):
            yield from settings(value, f"{name}.")
        else:
            yield name, _written(value), notes.get(field.name, "")


def _page(title: str, head: str, algorithm: Any, about: str | None) -> str:
    rows = [[f"`{name}`", value, note] for name, value, note in settings(algorithm.Config())]
    losses = ", ".join(f"`{loss}`" for loss in algorithm.LOSSES)
    return f"""# {title}

{head}
{markdown_of(about or "")}
## Settings

`--set NAME=VALUE` changes a setting, `settings` of a study does too.

{table(("setting", "default", "note"), rows)}
## Logged losses

`losses.csv` of a run has {losses}.
"""


def _written(value: Any) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{key}: {each}" for key, each in value.items()) or "none"
    if isinstance(value, tuple):
        return ", ".join(map(_written, value)) or "none"
    if isinstance(value, bool) or value is None:
        return {True: "`true`", False: "`false`", None: "none"}[value]
    return f"`{value}`" if value != "" else "empty"
