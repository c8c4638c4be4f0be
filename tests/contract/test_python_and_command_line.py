"""Python and the command line say the same: names, defaults and accepted types."""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import pytest

pytest.importorskip("torch", reason="training is among the functions")

import swarmdata
from swarmdata.evaluation.runs.generated_dataset import DEFAULT_STEPS
from swarmdata.specs.task_spec import TaskSpec
from tests.architecture.test_documentation import COMMANDS

RENAMED = {
    "checkpoints": "n_checkpoints",
    "episodes": "n_episodes",
    "id_": "id",
    "new_id": "id",
    "note": "metadata",
    "randomize": "randomization",
    "settings": "changes",
    "steps": "n_steps",
    "threads": "n_threads",
}
"""Options whose parameters have another name, the same in every command: counts are `n_...`."""

ONLY_PYTHON = {"progress": "bars show on terminals only", "report": "a function"}
"""Parameters that no command has."""


@dataclass(frozen=True)
class Pair:
    """A command and the function that it calls.

    Attributes:
        command: its words.
        function: public.
        options: options or arguments whose parameters are called otherwise here only.
        extra: options that this function has not, and why.
        absent: parameters that the command has not, and why.
    """

    command: str
    function: Callable[..., Any]
    options: Mapping[str, str] = field(default_factory=dict)
    extra: Mapping[str, str] = field(default_factory=dict)
    absent: Mapping[str, str] = field(default_factory=dict)

    def renamed(self, option: str) -> str:
        return self.options.get(option, RENAMED.get(option, option))


SETTING = "a setting, which `changes` holds"
PAIRS = (
    Pair(
        "train", swarmdata.train,
        {"data": "dataset_id", "seeds": "n_seeds", "reward": "rewards"},
        dict.fromkeys(("config", "regulariser", "updates"), SETTING),
        {"weights": "in the text of ID: ID=0.8,ID=0.2"},
    ),
    Pair(
        "train-online", swarmdata.train_online,
        extra={"config": SETTING, "steps": SETTING, "first_seed": "the first of `seeds`"},
        absent={"weights": "in the text of --data"},
    ),
    Pair(
        "tune", swarmdata.tune,
        {"data": "dataset_ids", "seeds": "n_seeds", "trials": "n_trials", "updates": "n_updates"},
        {"config": SETTING},
    ),
    Pair(
        "generate", swarmdata.generate, {"policy": "policies"},
        {"dataset": "a recipe, which `build` takes",
         **dict.fromkeys(("part", "finish", "remote"), "of a recipe's parts")},
    ),
    Pair("filter", swarmdata.filter_dataset, {"episodes": "episodes"}),
    Pair("combine", swarmdata.combine_datasets),
    Pair("subsample", swarmdata.subsample_dataset),
    Pair(
        "import", swarmdata.import_logs, absent={"splits": "those of every recording"},
    ),
    Pair("fetch", swarmdata.fetch_logs),
    Pair("export-policy", swarmdata.export_policy, {"run": "name", "out": "path"}),
    Pair("record recover", swarmdata.recover),
    Pair(
        "evaluate", swarmdata.evaluate,
        extra={
            **dict.fromkeys(("targets", "task", "label"), "give `policy`, `spec` and `name`"),
            **dict.fromkeys(("observation", "communication", "backend", "randomize"),
                            "change the spec"),
            **dict.fromkeys(("out", "again", "workers", "engine", "part", "collect", "budget"),
                            "of many results in a folder"),
            "validation": "the block `validation`",
        },
        absent={
            "seeds": "the reserved and the validation seeds are for everybody",
            **dict.fromkeys(("policy", "spec", "name"), "named by TARGET, --task and --label"),
            **dict.fromkeys(("n_copies", "policy_threads"), "changes no result"),
            "block": "--validation",
        },
    ),
)  # fmt: skip
ELSEWHERE = {
    ("generate", "steps"): DEFAULT_STEPS,  # with a recipe, its own
    ("generate", "policy"): inspect.Parameter.empty,  # checked by the command, beside a recipe
    ("generate", "task"): inspect.Parameter.empty,
    ("generate", "new_id"): inspect.Parameter.empty,
    ("fetch", "name"): inspect.Parameter.empty,  # without one, the command lists all
    ("import", "id_"): inspect.Parameter.empty,  # an imported recipe has one
    ("import", "out"): inspect.Parameter.empty,  # in the cache by default
    ("train", "out"): inspect.Parameter.empty,  # named after the algorithm and the data
    ("train-online", "out"): inspect.Parameter.empty,
    ("tune", "out"): inspect.Parameter.empty,
}
"""Defaults of options that the command's own text decides: those of the parameters."""


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: f"{pair.command}-{pair.function.__name__}")
def test_a_command_has_the_parameters_of_its_function(pair: Pair) -> None:
    options = {each.name: each for each in COMMANDS[pair.command].params}
    parameters = inspect.signature(pair.function).parameters
    named = {name: pair.renamed(name) for name in options if name not in pair.extra}
    assert not (missing := set(named.values()) - set(parameters)), f"no parameter for {missing}"
    unreachable = set(parameters) - set(named.values()) - set(pair.absent) - set(ONLY_PYTHON)
    assert not unreachable, f"{pair.command} has no option for {unreachable}"
    assert not set(pair.extra) - set(options), "stale rows of the table"
    assert not set(pair.absent) - set(parameters), "stale rows of the table"
    for option, name in named.items():
        in_python = parameters[name].default
        if isinstance(in_python, range):  # seeds, which the command counts
            in_python = len(in_python)
        expected = ELSEWHERE.get((pair.command, option), options[option].default)
        if expected is None and options[option].required:
            expected = inspect.Parameter.empty
        assert in_python == expected, f"{pair.command} --{option} and {name} differ"


def functions() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Every public function, and every public method of every public class."""
    for name in swarmdata.__all__:
        found = getattr(swarmdata, name)
        if not inspect.isclass(found):
            yield name, inspect.unwrap(found)  # some are cached
            continue
        for method, value in list(vars(found).items()):
            function = getattr(value, "__func__", value)
            if inspect.isfunction(function) and not method.startswith("_"):
                yield f"{name}.{method}", function


FUNCTIONS = dict(functions())

DEFAULTS = {
    "batch_size": (256,),
    "n_copies": (1, 64),  # 64 where copies only make it faster
    "n_threads": (1,),
    "progress": (True, None),  # None: a function, of `rollout`
    "seed": (0, None),  # None: drawn, or made of the id
    "tier": ("edited", "own"),
    "workers": (1, None),  # None: one for each core, where processes only make it faster
}
"""Defaults of parameters that many functions have."""


def test_a_name_has_one_default_and_one_meaning() -> None:
    found: dict[str, set[Any]] = {}
    for function in FUNCTIONS.values():
        for parameter in inspect.signature(function).parameters.values():
            if parameter.default is not parameter.empty and parameter.name in DEFAULTS:
                found.setdefault(parameter.name, set()).add(parameter.default)
    assert found == {name: set(values) for name, values in DEFAULTS.items()}


def test_counts_are_called_so() -> None:
    """`n_steps`, not `steps`: what is called by its plural holds several."""
    for name, function in FUNCTIONS.items():
        for parameter in inspect.signature(function).parameters.values():
            is_count = parameter.annotation in (int, int | None)
            assert not (is_count and parameter.name in RENAMED), f"{name}({parameter.name})"


TAKES_SPECS_ONLY = ("check_policy", "check_task", "drawn_values")
"""Functions about worlds that a user has built already."""


@pytest.mark.parametrize("name", FUNCTIONS)
def test_paths_and_tasks_are_taken_in_every_form(name: str) -> None:
    """A folder may be text or a path; a task a preset's name, a file or a spec."""
    for parameter in inspect.signature(FUNCTIONS[name]).parameters.values():
        kinds = get_args(parameter.annotation) or (parameter.annotation,)
        if Path in kinds:
            assert str in kinds, f"{parameter.name} takes no text"
        if TaskSpec in kinds and name not in TAKES_SPECS_ONLY:
            assert str in kinds, f"{parameter.name} takes no name of a preset"
            assert Path in kinds, f"{parameter.name} takes no file"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_parameters_are_documented(name: str) -> None:
    """Each by its name under `Args:`, or where one line says all, in the text."""
    text = inspect.getdoc(FUNCTIONS[name]) or ""
    assert text, "no docstring"
    if "Args:" not in text:
        return
    parameters = list(inspect.signature(FUNCTIONS[name]).parameters)
    for each in parameters[1:] if "." in name else parameters:
        assert re.search(rf"^ +\*{{0,2}}{each}: ", text, re.MULTILINE), f"{each} is not documented"


@pytest.mark.parametrize("command", COMMANDS)
def test_options_have_help_and_show_their_defaults(command: str) -> None:
    for parameter in COMMANDS[command].params:
        assert parameter.help, f"{command} {parameter.name} has no help"
