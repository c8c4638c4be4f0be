"""Pages of published data: the index of cards and of studies, the formats, and the layouts."""

from importlib import import_module

from docs.site.docstrings import markdown_of
from docs.site.staged_pages import ROOT
from docs.site.task_pages import columns_table, percent
from swarmdata.drawing.markdown import table
from swarmdata.interop.conversion.dataset_facts import DATASET_FACTS
from swarmdata.interop.formats import FORMATS, Format, all_formats
from swarmdata.registry.components import make_task
from swarmdata.registry.presets import name_of, preset
from swarmdata.registry.published import published, references
from swarmdata.registry.recipes import find_recipe
from swarmdata.specs.communication_names import communication_model
from swarmdata.specs.observation_names import observation_model
from swarmdata.store.arrays.attributes import FRAME_MEANINGS, SENSED_NOTES
from swarmdata.store.arrays.column_meanings import observation_columns
from swarmdata.store.arrays.layout import ALL_FIELDS, ROW_MEANINGS

SENSORS = ("state", "lidar", "bearing", "occupancy-5")  # whose columns are shown, in `coop_nav`

RADIOS = ("none", "pose", "goal", "errand", "state", "learned-4")  # whose columns are shown

YOUR_DATA = ROOT / "docs/your-data.md"

FACT_TITLES = {
    "observations": "observations, with the last one",
    "states": "global states, with the last one",
    "sent": "messages sent",
    "delivered": "messages delivered",
    "ages": "age of the newest message",
    "alive": "which agents still act",
    "action_masks": "action masks",
    "actions": "actions",
    "log_probs": "log-probabilities of actions",
    "rewards": "rewards of each agent",
    "terminations": "terminations",
    "truncations": "truncations",
    "events": "contacts and collisions",
    "reward_terms": "unweighted terms of the rewards",
    "agent_terminations": "terminations of each agent",
    "agent_truncations": "truncations of each agent",
    "layout": "obstacles",
    "seed": "seed",
    "policy": "behavior policy",
    "end_reason": "end reason",
    "split": "split",
    "spec": "task, or spaces of a recording",
}


def data_pages() -> dict[str, str]:
    """All of these pages."""
    return {
        "cards/published/index.md": dataset_index(),
        "cards/studies/index.md": study_index(),
        "reference/formats/index.md": _format_index(),
        **{f"reference/formats/{each.name}.md": format_page(each) for each in all_formats()},
        "reference/layouts/index.md": layout_page(),
        **{f"reference/layouts/{_kind(name)}.md": sensor_page(name) for name in SENSORS},
    }


def dataset_index() -> str:
    """Every published dataset, with the figures of its card."""
    text = (
        "# Datasets, one by one\n\nEvery published dataset; its name leads to its card. [Which "
        "dataset?](../../docs/which-dataset.md) helps to choose. Returns and success are those of "
        "the recorded episodes; a score of 0 is no skill, 100 the expert. A full dataset has "
        "1,000,000 joint steps, a mini the first 5 % of them.\n"
    )
    for minis, title in ((False, "Full datasets"), (True, "Minis")):
        rows = []
        for key, entry in published().items():
            if ("-mini-" in key) is not minis:
                continue
            recipe = find_recipe(key)
            known = references().get(name_of(recipe.spec))
            score = known.score(entry.mean_return) if known else None
            rows.append([
                f"[`{key}`]({key}.md)", str(recipe.spec.n_agents),
                f"{entry.n_episodes:,}", f"{entry.n_bytes / 1e6:,.0f}",
                f"{entry.mean_return:.2f}", "" if score is None else f"{score:.1f}",
                percent(entry.success), percent(entry.clean_success),
            ])  # fmt: skip
        head = ("dataset", "robots", "episodes", "MB", "return", "score",
                "success", "clean success")  # fmt: skip
        text += f"\n## {title}\n\n{table(head, rows, is_numeric=True)}"
    return text


def study_index() -> str:
    """Every committed study of this version of the worlds, by its report."""
    rows = []
    for report in sorted((ROOT / "cards/studies").glob("*/report.md")):
        title = report.read_text(encoding="utf-8").splitlines()[0].lstrip("# ")
        rows.append([f"[{report.parent.name}]({report.parent.name}/report.md)", title])
    return (
        "# Studies\n\nReports as `swarmdata study` wrote them. "
        "[Results](../../docs/results/index.md) has one page for each question.\n\n"
        + table(("study", "title"), rows)
    )


def format_page(each: Format) -> str:
    """The page of a foreign format."""
    module = import_module(FORMATS[each.name].partition(":")[0])
    ways = [f"    swarmdata convert coop_nav-medium-mini out --to {each.name}\n"]
    if each.read is not None:
        ways.append(f"    swarmdata convert data --from {each.name} --id mine-again-v0\n")
    text = f"# {each.title}\n\n{''.join(ways)}\n{markdown_of(module.__doc__ or '')}"
    rows = [
        [meaning, f"`{each.kept[fact]}`" if fact in each.kept else "lost", each.lost.get(fact, "")]
        for fact, meaning in FACT_TITLES.items()
    ]
    kept = table(("of a dataset", "kept as", "why it is lost"), rows)
    return f"{text}\n## What an export keeps\n\n{kept}"


def _format_index() -> str:
    rows = [
        [f"[`{each.name}`]({each.name}.md)", each.title,
         "written" if each.read is None else "read and written"]
        for each in all_formats()
    ]  # fmt: skip
    return (
        "# Formats, one by one\n\n"
        "[Your data](../../docs/your-data.md#convert-files) is the guide.\n\n"
        f"{table(('format', 'name', 'can be'), rows)}"
    )


def layout_page() -> str:
    """The arrays of a dataset, and where their columns are described."""
    rows = [
        [f"`{name}`", field.dtype, ", ".join(field.dimensions), field.unit, field.meaning]
        for name, field in ALL_FIELDS.items()
    ]
    row_kinds = [[f"`{name}`", meaning] for name, meaning in ROW_MEANINGS.items()]
    sensors = [[f"[`{name}`]({_kind(name)}.md)", SENSED_NOTES[_kind(name)]] for name in SENSORS]
    frames = [[name, meaning] for name, meaning in FRAME_MEANINGS.items()]
    messages = []
    for name in RADIOS:
        spec = preset("coop_nav").with_updates(communication=communication_model(name))
        seen = [
            c.name for c in observation_columns(make_task(spec)) if c.name.startswith("message_0.")
        ]
        shown = ", ".join(f"`{each.removeprefix('message_0.')}`" for each in seen) or "nothing"
        messages.append([f"`{name}`", shown])
    return f"""# Layouts

What each array of a dataset holds. Columns of states, actions and rewards are on the page of each
[task](../tasks/index.md), those of observations on the pages below. The same meanings are
attributes of the Zarr arrays themselves.

## Arrays

{table(("array", "type", "dimensions", "unit", "meaning"), rows)}
`rows` of an array are one of these:

{table(("rows", "meaning"), row_kinds)}
## Frames of reference

{table(("frame", "meaning"), frames)}
## Observations

{table(("sensor", "how it is laid out"), sensors)}
## Received messages

Observations end with a slot `message_k` for each other robot, whose columns depend on what is sent:

{table(("radio", "columns of a slot"), messages)}"""


def sensor_page(name: str) -> str:
    """The columns of one observation model in `coop_nav`."""
    spec = preset("coop_nav").with_updates(observation=observation_model(name))
    kind = _kind(name)
    columns, model = observation_columns(make_task(spec)), type(spec.observation).__name__
    return f"""# Observations of `{kind}`

{SENSED_NOTES[kind]} The fields of the model are in [the schema of
tasks](../schemas/task.md#{model.lower()}). These are the {len(columns)} columns of `{name}` in
`coop_nav`; other tasks add their own.

{columns_table(columns)}"""


def _kind(name: str) -> str:
    return name.partition("-")[0]


def your_data_page() -> str:
    """`docs/your-data.md` with its table of formats written anew: what an export loses."""
    text = YOUR_DATA.read_text(encoding="utf-8")
    head, rows = ("name", "format", "direction", "an export loses"), []
    for each in all_formats():
        lost = ", ".join(f"`{fact}`" for fact in DATASET_FACTS if fact in each.lost)
        direction = "write" if each.read is None else "both ways"
        rows.append([f"`{each.name}`", each.title, direction, lost or "nothing"])
    before, old, after = text.partition(f"| {' | '.join(head)} |\n")
    if not old:
        raise ValueError(f"{YOUR_DATA} has no table of {head}")
    return before + table(head, rows) + after[after.index("\n\n") + 1 :]
