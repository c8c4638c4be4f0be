"""HTML elements as text: whatever is not `Html` already is escaped."""

import html

VOID_ELEMENTS = frozenset({"input", "link", "meta", "br"})
"""Elements without content, which have no end tag."""


class Html(str):
    """Text that is HTML already and is not escaped again."""

    __slots__ = ()


def element(tag: str, /, *content: object, **attributes: object) -> Html:
    """Returns one element.

    Args:
        tag: its name.
        content: what is inside; all but `Html` is converted to text and escaped.
        attributes: by name, in which a final `_` is left out and any other `_` becomes `-`. None
            and False leave the attribute out, True gives it without a value.
    """
    words = [tag]
    for key, value in attributes.items():
        if value is None or value is False:
            continue
        attribute = key.rstrip("_").replace("_", "-")
        words.append(attribute if value is True else f'{attribute}="{html.escape(str(value))}"')
    start = f"<{' '.join(words)}>"
    return Html(start if tag in VOID_ELEMENTS else f"{start}{join(*content)}</{tag}>")


def join(*content: object) -> Html:
    """Returns the parts one after the other; all but `Html` is escaped."""
    return Html(
        "".join(part if isinstance(part, Html) else html.escape(str(part)) for part in content)
    )


def section(title: str, key: str, *content: object, **attributes: object) -> Html:
    """Returns a section whose heading, with the id `key`, names it."""
    heading = element("h2", title, id=key)
    return element("section", heading, *content, **attributes, aria_labelledby=key)


def table(head: tuple[str, ...], rows: list[tuple[object, ...]], **attributes: object) -> Html:
    """Returns a table whose first column names the rows."""
    header = element("tr", *(element("th", name, scope="col") for name in head))
    body = [
        element(
            "tr", element("th", row[0], scope="row"), *(element("td", each) for each in row[1:])
        )
        for row in rows
    ]
    inside = join(element("thead", header), element("tbody", *body))
    return element("div", element("table", inside, **attributes), class_="wide")
