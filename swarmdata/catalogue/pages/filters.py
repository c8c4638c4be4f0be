"""The form that filters a page, whose choices `assets/filters.js` keeps in the address."""

from collections.abc import Mapping, Sequence

from swarmdata.catalogue.elements import Html, element


def form(label: str, fields: Sequence[Html]) -> Html:
    """Returns the form, with a button that clears it."""
    clear = element("button", "Clear", type="reset")
    return element("form", *fields, clear, id="filters", role="search", aria_label=label)


def choice(
    label: str,
    name: str,
    values: Sequence[str] = (),
    *,
    labels: Mapping[str, str] | None = None,
    default: str = "",
    every: str | None = "",
) -> Html:
    """Returns a list to choose from, of values or of values with labels.

    `every` is the value that stands for all; None: one has to be chosen.
    """
    known = labels or dict(zip(values, values, strict=True))
    if every is not None:
        known = {every: "all", **known}
    options = [element("option", v, value=k, selected=k == default) for k, v in known.items()]
    return element("label", label, element("select", *options, name=name))


def nothing_found(things: str) -> list[Html]:
    """The count of what is shown, and what is said, with ways to widen, where nothing is."""
    return [
        element("p", id="shown", role="status", data_things=things),
        element("div", id="widen", hidden=True),
    ]
