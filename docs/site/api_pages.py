"""The reference of the public names, which Sphinx writes from their docstrings."""

import inspect
from importlib import import_module

import swarmdata
from docs.site.docstrings import summary_of
from swarmdata import errors
from swarmdata.datasets.views import TrainingData
from swarmdata.drawing.markdown import table
from swarmdata.specs.frozen import Frozen

GROUPS = {
    "data": (
        "Datasets",
        ("load", "list_datasets", "Dataset", "DatasetInfo", "Batch", "Episode", "Reference",
         "Stream", "StreamedDataset"),
    ),
    "worlds": (
        "Worlds and policies",
        ("preset", "preset_names", "TaskSpec", "TaskRules", "make_task",
         "make_env", "Step", "Policy",
         "make_policy", "FunctionPolicy", "frame_of", "rollout", "drawn_values"),
    ),
    "learning": (
        "Training and evaluation",
        ("train", "train_online", "evaluate", "EvalResult", "Result", "Provenance", "save_result",
         "estimate", "read_results", "tune"),
    ),
    "making": (
        "Making datasets",
        ("generate", "build", "Recipe", "filter_dataset", "combine_datasets", "subsample_dataset"),
    ),
    "recording": (
        "Recording other environments",
        ("Recorder", "recover", "record_vmas", "record_jax", "RecordedSpec", "evaluate_parallel",
         "foreign_evaluation_seeds"),
    ),
    "formats": (
        "Other formats",
        ("export_dataset", "import_dataset", "import_logs", "fetch_logs", "fit_twin",
         "export_policy", "register_torchrl", "make_torchrl_env"),
    ),
    "extending": (
        "Extending",
        ("register_algorithm", "register_policy", "register_task", "register_remote",
         "check_algorithm", "check_online_algorithm", "check_policy", "check_remote", "check_task",
         "check_dataset", "LogUniform", "Choice"),
    ),
    "errors": ("Errors", ("SwarmdataError",)),
}  # fmt: skip
"""Title and public names of each page."""

PROTOCOLS = ("Task", "VecEnv", "Policy", "Algorithm", "OnlineAlgorithm")  # that users implement

OF_FILES = ("from_file", "from_text", "to_yaml", "hash")  # methods that all frozen models inherit


def api_pages() -> dict[str, str]:
    """A page for each group of names, and their index."""
    pages = {f"reference/api/{group}.md": api_page(group) for group in GROUPS}
    text = (
        "# Python reference\n\nEvery public name, as in `swarmdata.NAME`. Anything else may change "
        "without notice.\n"
    )
    for title, names in GROUPS.values():
        rows = [
            [f"{{py:obj}}`{name} <swarmdata.{name}>`", summary_of(getattr(swarmdata, name).__doc__)]
            for name in names
        ]
        text += f"\n## {title}\n\n{table(('name', 'what it is'), rows)}"
    pages["reference/api/index.md"] = text
    return pages


def api_page(group: str) -> str:
    """The page of one group, as directives for Sphinx."""
    title, names = GROUPS[group]
    blocks = [_directive("swarmdata", name) for name in names]
    if group == "errors":
        words, tree = inspect.cleandoc(errors.__doc__ or "").split("\n\nSwarmdataError\n", 1)
        tree = f"```text\nSwarmdataError\n{tree}\n```\n"
        types = [name for name, value in vars(errors).items() if _is_error(value)]
        blocks = [words.partition("\n\n")[2], tree]
        blocks += [_directive("swarmdata.errors", name) for name in types]
    if group == "extending":
        blocks += [
            "## Protocols\n",
            *(_directive("swarmdata.interfaces", name) for name in PROTOCOLS),
        ]
    return f"# {title}\n\n" + "\n".join(blocks)


def _directive(module: str, name: str) -> str:
    found = getattr(import_module(module), name)
    is_class = isinstance(found, type)
    options = "   :members:\n" if is_class else ""
    if is_class and issubclass(found, TrainingData):  # which has most of what views can do
        options += "   :inherited-members:\n"
    if is_class and issubclass(found, Frozen):
        hidden = (*found.model_fields, *sorted(found.__class_vars__), "model_config")
        options += f"   :exclude-members: {', '.join(hidden)}\n\n"
        options += "".join(f"   .. automethod:: {method}\n" for method in OF_FILES)
    kind = "function" if not is_class else "exception" if _is_error(found) else "class"
    return f"```{{eval-rst}}\n.. auto{kind}:: {module}.{name}\n{options}```\n"


def _is_error(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, errors.SwarmdataError)
