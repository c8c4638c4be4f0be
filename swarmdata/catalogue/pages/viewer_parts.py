"""The parts of a dataset's page that scripts fill: the viewer and the table of episodes."""

from collections.abc import Mapping

from swarmdata.catalogue.elements import Html, element, join
from swarmdata.registry.components import appearance_of
from swarmdata.specs.model_choice import describe
from swarmdata.specs.sensing_models import Broadcast, StateModel
from swarmdata.specs.task_spec import TaskSpec

SPEEDS = ("0.25", "0.5", "1", "2", "4", "8")

NUMBERS = frozenset({"return", "length", "time", "collisions"})
"""Columns that are aligned to the right."""

SLIDER = element("input", type="range", min="0", value="0", aria_label="Time")

KEYS = (("Space", "play or pause"), ("← →", "one step; with Shift ten"), ("Home End", "start, end"))


def world_viewer(spec: TaskSpec, recorded: TaskSpec) -> Html:
    """The viewer of replays, for one episode or two, with the models shown and those recorded."""
    options = [("trails", "trails", True), ("targets", "targets", True)]
    if _has_visible_sensors(spec):
        options.append(("sensors", "sensors", False))
    if isinstance(spec.communication, Broadcast):
        options.append(("radio", "radio", True))
    options.append(("numbers", "numbers", False))
    toggles = []
    for key, label, is_on in options:
        toggle = element("input", type="checkbox", data_option=key, checked=is_on)
        toggles.append(element("label", toggle, f" {label}", class_="check"))
    canvas = element("canvas", role="img", aria_label="Replay of an episode")
    tracks = [
        element("svg", class_="track", aria_hidden="true", hidden=hidden)
        for hidden in (False, True)
    ]
    text = f"Shown with {describe(spec)}. The policies acted with {describe(recorded)}."
    return _viewer(
        "s",
        _stage(canvas, is_titled=False),
        element("div", *tracks, SLIDER, class_="time"),
        _controls(),
        element("fieldset", element("legend", "Show"), *toggles, class_="toggles"),
        _legend(spec),
        element("p", text, class_="legend") if spec != recorded else "",
        element("details", element("summary", "Events"), element("ol"), class_="events"),
    )


def series_viewer() -> Html:
    """The viewer of arrays over time, for one episode or two."""
    content = join(element("div", class_="pictures", hidden=True), element("div", class_="lines"))
    time = element("div", SLIDER, class_="time")
    return _viewer("steps", time, _controls(), _stage(content, is_titled=True))


def _stage(content: Html, *, is_titled: bool) -> Html:
    """Places for two episodes; the second one is hidden at first."""
    choice = element(
        "div",
        element("label", "Dataset", element("select", name="dataset")),
        element("label", "Episode", element("input", name="other", type="number", min="0")),
        class_="choice",
    )
    figures = []
    for more in ((), (choice,)):
        caption = element("figcaption", element("span", class_="outcome"), *more)
        parts = (caption, content) if is_titled else (content, caption)
        figures.append(element("figure", *parts, hidden=bool(more)))
    return element("div", *figures, class_="stage")


def episode_table(columns: Mapping[str, str], explanation: str, choices: Mapping[str, str]) -> Html:
    """The table that `assets/episode_table.js` fills, with its histograms and choices.

    Columns are keys with heads; `choices` are keys of columns that are chosen from a list, with
    labels.
    """
    head = []
    for key, label in columns.items():
        sorter = element("button", label, type="button", data_sort=key)
        looks = "n" if key in NUMBERS else None
        head.append(element("th", sorter, scope="col", data_column=key, class_=looks))
    lists = [
        element("label", label, element("select", element("option", "all", value=""), name=name))
        for name, label in choices.items()
    ]
    clear = element("button", "Clear filters", type="button", class_="clear")
    count = element("span", class_="count", role="status")
    table = element(
        "table", element("thead", element("tr", *head)), element("tbody"), aria_label="Episodes"
    )
    return element(
        "section",
        element("h2", "Episodes", id="episodes"),
        element("p", f"{explanation} Drag over a histogram, or type its ends, to filter."),
        element("div", class_="histograms"),
        element("div", *lists, clear, count, class_="choices"),
        element("div", table, class_="rows", tabindex="0", role="region", aria_label="Episodes"),
        element("button", "Show more", type="button", class_="more", hidden=True),
        id="browse",
        aria_labelledby="episodes",
    )


def _viewer(unit: str, *parts: object) -> Html:
    notice = element("p", id="notice", role="status")
    without = element("noscript", element("p", "Replays need JavaScript."))
    return element(
        "section", without, notice, *parts, id="viewer", aria_label="Replay", data_unit=unit
    )


def _controls() -> Html:
    side = element("button", "Side by side", type="button", class_="compare", aria_pressed="false")
    speeds = [
        element("option", f"{speed} ×", value=speed, selected=speed == "1") for speed in SPEEDS
    ]
    keys = [join(element("kbd", key), f" {meaning} ") for key, meaning in KEYS]
    return element(
        "div",
        element("button", "▶", type="button", class_="play", aria_label="Play"),
        element("span", class_="clock"),
        element("select", *speeds, name="speed", aria_label="Speed"),
        element("button", "‹", type="button", class_="previous", aria_label="Previous episode"),
        element("button", "›", type="button", class_="next", aria_label="Next episode"),
        side,
        element("button", "Copy link", type="button", class_="share"),
        element("span", *keys, class_="keys"),
        class_="controls",
    )


def _has_visible_sensors(spec: TaskSpec) -> bool:
    """Whether the sensors have a reach that can be drawn."""
    model = spec.observation
    is_limited = not isinstance(model, StateModel) or model.limit is not None
    return is_limited or any(robot.sensor_range is not None for robot in spec.robots)


def _legend(spec: TaskSpec) -> Html:
    text = f"{appearance_of(spec).legend} A red halo is a contact. Above the time bar: the return "
    text += "so far, and a tick for each event."
    if spec.observation.kind == "lidar":
        text += (
            " Beams are computed from the positions drawn, without the noise, losses and delay of "
            "the sensor."
        )
    radio = spec.communication
    if isinstance(radio, Broadcast):
        text += " Arrows are messages that arrive, in the color of the sender"
        if radio.delay:
            text += f", dotted because they are {radio.delay * spec.control_dt:.1f} s late"
        text += "; dashes that end in a cross are messages that were lost."
    return element("p", text, class_="legend")
