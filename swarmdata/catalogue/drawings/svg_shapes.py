"""SVG elements: numbers are rounded, so that drawings are small and the same everywhere."""

from collections.abc import Sequence

from swarmdata.catalogue.elements import Html, element

Point = tuple[float, float]


def hex_color(color: tuple[int, int, int]) -> str:
    """Returns a color in the notation of style sheets."""
    return "#{:02x}{:02x}{:02x}".format(*color)


def number(value: float) -> str:
    """Returns a number with at most one decimal."""
    text = f"{value:.1f}"
    return text.removesuffix(".0") if text != "-0.0" else "0"


def disc(center: Point, radius: float, **attributes: object) -> Html:
    """Returns a circle."""
    x, y = center
    return element("circle", cx=number(x), cy=number(y), r=number(radius), **attributes)


def line(start: Point, end: Point, **attributes: object) -> Html:
    """Returns a straight line."""
    ends = dict(zip(("x1", "y1", "x2", "y2"), map(number, (*start, *end)), strict=True))
    return element("line", **ends, **attributes)


def path(points: Sequence[Point], *, closed: bool = False, **attributes: object) -> Html:
    """Returns straight lines through the points."""
    words = "L".join(f"{number(x)} {number(y)}" for x, y in points)
    return element("path", d=f"M{words}{'Z' if closed else ''}", **attributes)


def text(at: Point, words: str, **attributes: object) -> Html:
    """Returns a line of text."""
    return element("text", words, x=number(at[0]), y=number(at[1]), **attributes)


def drawing(width: float, height: float, label: str, *content: object, class_: str) -> Html:
    """Returns an SVG with a name for screen readers."""
    size, title = f"0 0 {number(width)} {number(height)}", element("title", label)
    return element(
        "svg", title, *content, viewBox=size, role="img", aria_label=label, class_=class_
    )


def picture(width: float, height: float, *content: object, class_: str) -> Html:
    """Returns an SVG that shows what text beside it says, hidden from screen readers."""
    size = f"0 0 {number(width)} {number(height)}"
    return element("svg", *content, viewBox=size, aria_hidden="true", class_=class_)


def share_bar(share: float) -> Html:
    """Returns a thin bar that is filled up to a share of its width."""
    bar = element("rect", width=number(100 * share), height="3", class_="some")
    whole = element("rect", width="100", height="3", class_="all")
    return element(
        "svg", whole, bar, viewBox="0 0 100 3", preserveAspectRatio="none", aria_hidden="true"
    )
