"""No command ignores an option: each one has an effect in some case, and elsewhere is refused.

A case is a command line up to the library function that does the work, which is replaced and keeps
its arguments. Every option of the command is added to it in turn. Then the arguments or the output
must differ, or the command must exit with an error that names the option. `idle` lists the options
that do nothing in one case for a reason that only the data know, such as `--repair` where nothing
is broken. A command or an option that is added without a case fails here.
"""

import importlib
import pkgutil
import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

import swarmdata
from swarmdata.cli.main import app
from swarmdata.registry.published import Published, TaskReferences
from swarmdata.specs.origins.log_origin import ImportedLogs

SAMPLES = {
    "--action-bounds": "-2,2",
    "--agents": "a,b",
    "--backend": "kinematic",
    "--by": "imitation_error",
    "--communication": "lossy-30",
    "--config": "coop_nav-expert",
    "--data": "coop_nav-medium",
    "--figures": "svg",
    "--engine": "dask://host:1",
    "--final": "cut",
    "--frame": "world",
    "--id": "coop_nav-other-v0",
    "--like": "coop_nav-expert",
    "--noise": "0.5",
    "--note": "license=mit",
    "--observation": "lidar",
    "--offline-share": "0.25",
    "--opponents": "scripted",
    "--out": "elsewhere.gif",
    "--part": "1/2",
    "--policy": "scripted=3",
    "--randomize": "mass=1..2",
    "--regulariser": "bc",
    "--reward": "time=2",
    "--side": "evader",
    "--set": "batch_size=7",
    "--task": "formation",
    "--unfinished": "drop",
}
"""Values that differ from defaults; of other options, numbers and words."""

AXES = {
    "--body": "max_speed=0.5,0.4",
    "--communication": "drop=0.1,0.2",
    "--observation": "noise=0.1,0.2",
}


@dataclass(frozen=True, eq=False)
class Case:
    """One way to use a command.

    Attributes:
        line: the command and what it needs.
        boundary: functions that are replaced, as "module:name"; the first that is called ends it.
        stubs: what other functions return instead of working.
        samples: values of options in this case.
        idle: options without effect here, with the reason.
    """

    line: str
    boundary: tuple[str, ...] = ()
    stubs: Mapping[str, Any] = field(default_factory=dict)
    samples: Mapping[str, str] = field(default_factory=dict)
    idle: Mapping[str, str] = field(default_factory=dict)


RUNS = "swarmdata.evaluation.runs"
RESULTS = "swarmdata.evaluation.results"
CATALOG = "swarmdata.hub.catalog.catalog"
EDIT = "swarmdata.building.edit"
REPAIR = "swarmdata.hub.catalog.repair"
REGENERATE = "swarmdata.hub.publishing.regenerate"
COMPARE = "swarmdata.evaluation.robustness.simulator_transfer:compare_simulators"
SWEEP = "swarmdata.evaluation.robustness.sweep"
STUDY = "swarmdata.evaluation.study.run_study"
CELL = SimpleNamespace(name="bc/a", n_updates=3, key="k", folder=Path, is_done=lambda folder: False)
IMPORTED = ImportedLogs.model_construct(id="hall-a-v0")
BROKEN = (SimpleNamespace(file="recipe.json", problem="is absent"),)
SOUND = {f"{CATALOG}:find_folder": Path("data"), f"{REPAIR}:examine": ()}
OPENED = {f"{CATALOG}:load": "a dataset"}
LOGS = "swarmdata.interop.logs.import_logs"
TWIN = "swarmdata.interop.logs.fitted_twin"
HALVES = SimpleNamespace(split=lambda name: name)
FITTED = SimpleNamespace(check=lambda *parts: len(parts), to_yaml=lambda: "spec")

SHARES = "swarmdata.building.shares"
BUILT = ("swarmdata.building.build:build", f"{SHARES}:make_share", f"{SHARES}:receive_parts",
         f"{SHARES}:finish_parts")  # fmt: skip
THROUGH = {"--remote": "file:///a"}
EVALUATED = (f"{RESULTS}.target_evaluation:evaluate_target",
             f"{RESULTS}.evaluation_jobs:run_evaluations")  # fmt: skip
STUDIED = tuple(f"{STUDY}:{name}" for name in ("run_study", "reproduce_study_cell", "list_cells",
                                               "run_one_cell", "collect_study"))  # fmt: skip
CATALOGUE = ("swarmdata.catalogue.build_catalogue:build_catalogue",)
OTHER_AXES = {**AXES, "--observation": "range=2,1"}
LATER = "the boundary ends the command before it"
COSTLESS = {"--budget": "read after the evaluation"}

CASES = (
    Case("list"),
    Case("algorithms"),
    Case("info coop_nav-medium"),
    Case("generate coop_nav-medium", BUILT, samples=THROUGH),
    Case("generate coop_nav-medium --out a", BUILT, samples=THROUGH),
    Case("generate coop_nav-medium --part 1/2", BUILT, samples={"--part": "2/2", **THROUGH}),
    Case("generate coop_nav-medium --finish", BUILT, samples=THROUGH),
    Case("generate --task coop_nav --policy idle --id coop_nav-a-v0",
         (f"{RUNS}.generated_dataset:generate",)),
    Case("verify data", ("swarmdata.audit:audit",),
         {**SOUND, "swarmdata.cli.integrity_commands:_compare": None},
         idle={"--repair": "nothing is broken"}),
    Case("verify data --repair", (f"{REPAIR}:repair",), {**SOUND, f"{REPAIR}:examine": BROKEN},
         idle={"--replay": LATER}),
    Case("card data", ("swarmdata.cards.card:write_card", "swarmdata.cards.publish:publish_card"),
         {f"{CATALOG}:find_folder": Path("data"), "swarmdata.cards.card:card_of": "a card\n"}),
    Case("card data --out a", ("swarmdata.cards.publish:publish_card",),
         {f"{CATALOG}:find_folder": Path("data")},
         idle={"--write": LATER}),
    Case("audit data", ("swarmdata.audit:audit",),
         {"swarmdata.cli.integrity_commands:_folder": Path("data")},
         idle={"--json": LATER}),
    Case("audit data", (),
         {"swarmdata.cli.integrity_commands:_folder": Path("data"),
          "swarmdata.audit:audit": SimpleNamespace(
              problems=(), to_json=lambda: "{}", to_text=lambda: "text")},
         idle={"--sample": "the audit is a stub here"}),
    Case("filter data --id coop_nav-a-v0", (f"{EDIT}:filter_dataset",), OPENED,
         {"--success": "", "--policy": "a"}),
    Case("combine one two --id coop_nav-a-v0", (f"{EDIT}:combine_datasets",), OPENED),
    Case("subsample data --id coop_nav-a-v0", (f"{EDIT}:subsample_dataset",), OPENED),
    Case("subsample data --id coop_nav-a-v0 --steps 9", (f"{EDIT}:subsample_dataset",), OPENED),
    Case("subsample data --id coop_nav-a-v0 --like b", (f"{EDIT}:subsample_dataset",),
         {f"{CATALOG}:load": str}),
    Case("push data file:///a"),
    Case("pull coop_nav-medium --from file:///a",
         ("swarmdata.hub.remotes.release_lookup:find_release",), {}, {"--from": "file:///b"},
         idle={"--out": LATER}),
    Case("pull coop_nav-medium --from file:///a", ("swarmdata.hub.catalog.sources:obtain_release",),
         {"swarmdata.hub.remotes.release_lookup:find_release":
              (None, SimpleNamespace(id="coop_nav-medium-v1", address="file:///a"))},
         idle={"--from": "the release is a stub here"}),
    Case("pull file:///a/coop_nav-medium-v1", ("swarmdata.hub.catalog.sources:obtain",
                                              "swarmdata.hub.remotes.release_lookup:locate"),
         samples={"--from": "file:///b"}),
    Case("train bc coop_nav-medium", (f"{RUNS}.train:train",), samples={"--config": "own.yaml"}),
    Case("train auto coop_nav-medium", (f"{RUNS}.train:train",), samples={"--config": "own.yaml"}),
    Case("tune bc coop_nav-medium", ("swarmdata.evaluation.tuning.tune:tune",),
         samples={"--config": "own.yaml"}),
    Case("train-online mappo coop_nav", (f"{RUNS}.train:train_online",)),
    Case("train-online vdn coop_nav --data coop_nav-expert", (f"{RUNS}.train:train_online",)),
    Case("ship coop_nav --out a", ("swarmdata.online_algos.runs.checkpoint_selection:ship",),
         {"swarmdata.learn.training.run_files:seeds_of": list}),
    Case("fetch", (), {}, {"--from": "logs"}),
    Case("fetch turtles", ("swarmdata.interop.logs.public_logs:fetch_logs",),
         samples={"--from": "logs"}),
    Case("fit hall-a-v0", (f"{TWIN}:fit_twin",), {f"{CATALOG}:load": HALVES},
         idle={"--test": LATER,
               "--out": LATER}),
    Case("fit hall-a-v0", (), {f"{CATALOG}:load": HALVES, f"{TWIN}:fit_twin": FITTED,
                               f"{TWIN}:describe": lambda *shown: str(shown)},
         idle={"--radius": "the fit is replaced", "--drift": "the fit is replaced"}),
    Case("export-policy run a.onnx", ("swarmdata.interop.exported_policies:export_policy",)),
    Case("rank run", ("swarmdata.evaluation.policy_selection.rank:rank",),
         samples={"--by": "td_error"},
         idle={"--out": LATER}),
    Case("rank run", (), {"swarmdata.evaluation.policy_selection.rank:rank":
         SimpleNamespace(write=typer.echo, to_text=lambda: "text")},
         {"--by": "td_error"},
         dict.fromkeys(["--dataset", "--by", "--checkpoints", "--episodes", "--results", "--set",
                        "--device"], "the ranking is a stub here")),
    Case("convert data a --to minari", ("swarmdata.interop.export:export_dataset",),
         {f"{CATALOG}:load": SimpleNamespace(filter=lambda **kept: kept)},
         {"--to": "vault", "--from": "minari", "--frame": "target"}),
    Case("convert data a --from minari --id a-b-v0", ("swarmdata.interop.convert:import_dataset",),
         samples={"--from": "vault", "--to": "minari", "--frame": "target"}),
    Case("import a.csv --map robots.yaml --id hall-a-v0", (f"{LOGS}:import_logs",),
         {f"{LOGS}:read_map": "a map"},
         {"--map": "other.yaml", "--task": "coop_nav"},
         idle={"--map": "the map is a stub here"}),
    Case("import a.csv --map recipe.json", (f"{LOGS}:remake_logs",),
         {f"{LOGS}:read_map": IMPORTED},
         idle={"--map": "the map is a stub here"}),
    Case("evaluate idle", EVALUATED, idle=COSTLESS),
    Case("evaluate idle --budget robot_collisions=1",
         ("swarmdata.cli.result_commands:_print_tables",),
         {f"{RESULTS}.target_evaluation:evaluate_target": [],
          f"{RESULTS}.evaluation_jobs:run_evaluations": 0,
          f"{RESULTS}.evaluation_jobs:collect_evaluations": []},
         {"--budget": "robot_collisions=2"},
         idle=dict.fromkeys(
             ("--out", "--episodes", "--task", "--label", "--validation", "--again",
              "--observation", "--communication", "--backend", "--randomize", "--threads",
              "--workers", "--engine", "--part", "--collect"), "evaluation is a stub here")),
    Case("evaluate idle --task tag --side pursuers --opponents random", EVALUATED,
         idle={**COSTLESS, "--task": "no other preset has sides"}),
    Case("evaluate idle --out a", (f"{RESULTS}.evaluation_jobs:run_evaluations",
                                   f"{RESULTS}.evaluation_jobs:collect_evaluations"),
         idle=COSTLESS),
    Case("evaluate idle random --out a --part 1/2",
         (f"{RESULTS}.evaluation_jobs:run_evaluations",), samples={"--part": "2/2"}),
    Case("evaluate idle --out a --collect", (f"{RESULTS}.evaluation_jobs:collect_evaluations",),
         idle=COSTLESS),
    Case("evaluate coop_nav-scripted", EVALUATED, idle=COSTLESS),
    Case("report a --out b", (f"{RESULTS}.report:write_report",)),
    Case("report run --out b", (f"{RESULTS}.online_report:write_online_report",),
         {"swarmdata.learn.training.run_files:run_folders": ("run",)}),
    Case("study plan.yaml", STUDIED),
    Case("study plan.yaml --cells", (),
         {f"{STUDY}:list_cells": SimpleNamespace(cells=(CELL,), open_sweeps=())},
         idle={"--work": "the cell is done in neither folder"}),
    *(Case(f"study plan.yaml {way}", STUDIED)
      for way in ("--cell bc/a", "--collect", "--check bc/a")),
    Case("study folder", ("swarmdata.evaluation.study.pages.study_folder:rewrite_pages",)),
    Case("study-cards", ("swarmdata.cards.publish:refresh_cards",),
         {"swarmdata.cards.committed_studies:read_studies": ()}),
    Case("sweep expert --out a --observation noise=0..0.2", (f"{SWEEP}:plan_sweep",), {}, AXES,
         dict.fromkeys(("--workers", "--engine", "--points", "--json", "--point", "--collect"),
                       "the plan is the same")),
    Case("sweep expert --out a --observation noise=0.1,0.2",
         (f"{SWEEP}:run_sweep", f"{SWEEP}:run_point", f"{SWEEP}:collect_sweep"),
         samples=OTHER_AXES),
    Case("sweep expert --out a --observation noise=0..0.2 --points", (), {},
         OTHER_AXES,
         {"--out": "the points are done in neither folder",
          "--episodes": "how many there are is not listed", "--validation": "nor which",
          "--task": "neither is the task",
          "--backend": "nor is the simulator", "--randomize": "nor are ranges"}),
    Case("sweep expert --out a --observation noise=0..0.2 --point b", (f"{SWEEP}:run_point",),
         samples=OTHER_AXES),
    Case("sweep expert --out a --observation noise=0..0.2 --collect",
         (f"{SWEEP}:collect_sweep",), samples=OTHER_AXES),
    Case("sweep idle --out a --simulator mujoco", (COMPARE,)),
    Case("warm", ("swarmdata.building.kernel_warmup:warm_kernels",)),
    Case("render idle --out a.gif", (f"{RESULTS}.clips:draw_target",)),
    Case("references coop_nav", (f"{RESULTS}.target_evaluation:measure_references",),
         idle={"--out": LATER}),
    Case("references coop_nav", (f"{REGENERATE}:put_entries",),
         {f"{RESULTS}.target_evaluation:measure_references": TaskReferences("", 1, {}, {})},
         idle={"--episodes": "nothing is measured here"}),
    *(Case(f"catalogue build {what}", CATALOGUE)
      for what in ("coop_nav-medium", "--minis", "coop_nav-medium --all")),
    Case("catalogue open", ("swarmdata.catalogue.site_folder:is_site",)),
    Case("leaderboard submit run --dataset a --name b --license c --code d --trials 2 "
         "--tuning-episodes 3 --out e", ("swarmdata.evaluation.leaderboard.entry:submit",)),
    Case("leaderboard verify a", ("swarmdata.evaluation.leaderboard.verify:verify",)),
    Case("task list"),
    Case("task show coop_nav"),
    Case("task validate coop_nav", ("swarmdata.rollouts.spec_check:probe",)),
    Case("task table --out a", ("swarmdata.store:write_file",)),
    Case("task play coop_nav --out a.gif", (f"{RESULTS}.clips:draw_target",),
         samples={"--policy": "idle"}),
    Case("task play coop_nav --out a.png", (f"{RESULTS}.clips:draw_target",),
         samples={"--policy": "idle", "--out": "b.png"}),
    Case("registry list"),
    Case("registry check", (f"{REGENERATE}:check",), samples={"--id": "coop_nav-medium"}),
    Case("registry update --id coop_nav-medium", (f"{REGENERATE}:make_again",),
         idle={"--id": "the boundary ends the command at the first id",
               "--out": LATER}),
    Case("registry update --id coop_nav-medium", (f"{REGENERATE}:put_entries",),
         {f"{REGENERATE}:make_again":
              Published(1, 1, 0.0, 0.0, 0.0, "coop_nav", 1, "", "", "", 1, {}, {})},
         idle={"--id": "the boundary ends the command at the first id",
               "--cached": "nothing is built here",
               "--engine": "nothing is built here",
               "--workers": "nothing is built here"}),
    Case("remote list"),
    Case("remote add file:///a", ("swarmdata.hub.remotes.addresses:store_remotes",),
         idle={"--first": "the order is in the function that the boundary gets"}),
    Case("remote add file:///a", (),
         {"swarmdata.hub.remotes.addresses:store_remotes": lambda put: put(("file:///b",))}),
    Case("remote remove file:///a"),
    Case("record recover a"),
    Case("record show a"),
)  # fmt: skip


def commands() -> Iterator[tuple[str, Any]]:
    """Every command of the app by its words."""

    def below(group: Any, words: tuple[str, ...]) -> Iterator[tuple[str, Any]]:
        for name, command in group.commands.items():
            if hasattr(command, "commands"):
                yield from below(command, (*words, name))
            else:
                yield " ".join((*words, name)), command

    return below(typer.main.get_command(app), ())


COMMANDS = dict(commands())


def command_of(case: Case) -> str:
    words = case.line.split()
    return next(" ".join(words[:n]) for n in (2, 1) if " ".join(words[:n]) in COMMANDS)


def options_of(command: str) -> dict[str, Any]:
    """The options of a command by their first name, without `--help`."""
    params = COMMANDS[command].params
    return {p.opts[0]: p for p in params if p.param_type_name == "option" and p.name != "help"}


def sample_of(case: Case, option: str, parameter: Any) -> list[str]:
    if parameter.is_flag:
        is_default = bool(parameter.default)
        return [parameter.secondary_opts[0] if is_default else option]
    value = case.samples.get(option) or SAMPLES.get(option)
    if value is None:
        kind = parameter.type_descriptor.annotation
        value = {int: "77", list[int]: "77", float: "5"}.get(kind, "other")
    return [option, value]


class Reached(Exception):  # noqa: N818  (it ends a command, and is no error)
    """A boundary was called."""


def run(case: Case, *extra: str) -> tuple[int, str]:
    """Exit code, and the output with the arguments of the boundary."""
    called: list[str] = []

    def boundary(name: str) -> Any:
        def reached(*arguments: Any, **options: Any) -> Any:
            called.append(f"{name} {shown(arguments)} {shown(options)}")
            raise Reached

        return reached

    with pytest.MonkeyPatch.context() as patch:
        for name, value in case.stubs.items():
            work = value if callable(value) and not isinstance(value, SimpleNamespace) else None
            patch.setattr(name.replace(":", "."), work or (lambda *a, _v=value, **k: _v))
        for name in case.boundary:
            patch.setattr(name.replace(":", "."), boundary(name))
        result = CliRunner().invoke(app, [*case.line.split(), *extra])
    if result.exception is not None and not isinstance(result.exception, Reached | SystemExit):
        raise result.exception
    code = 0 if isinstance(result.exception, Reached) else result.exit_code
    return code, result.output + "".join(called)


def shown(value: Any) -> str:
    """Arguments as text, without the addresses of objects."""
    if isinstance(value, Mapping):
        return str({key: shown(each) for key, each in value.items()})
    if isinstance(value, tuple | list):
        return str([shown(each) for each in value])
    if hasattr(value, "spec") and hasattr(value, "provenances"):
        return f"{value.measured.hash()} {value.provenances}"
    return re.sub(r" at 0x[0-9a-f]+", "", str(value))


@pytest.fixture(scope="module", autouse=True)
def every_module() -> None:
    """Imports all modules: one that is first imported beside a replaced function would keep it."""
    for module in pkgutil.walk_packages(swarmdata.__path__, "swarmdata."):
        with suppress(ImportError):  # of an extra that is not installed
            importlib.import_module(module.name)


def test_every_command_with_options_has_a_case() -> None:
    assert {command_of(case) for case in CASES} == set(COMMANDS)


@pytest.mark.parametrize("command", sorted(COMMANDS))
def test_every_option_has_an_effect_or_is_refused(
    command: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And has an effect in some case."""
    pytest.importorskip("torch", reason="training, ranking and studies need torch")
    pytest.importorskip("matplotlib", reason="figures need the plots extra")
    used = set[str]()
    for number, case in enumerate(case for case in CASES if command_of(case) == command):
        monkeypatch.chdir(write_files(tmp_path / str(number)))
        used |= check_options(case, options_of(command))
    assert used == options_of(command).keys()


def write_files(folder: Path) -> Path:
    """A folder with the files that cases name."""
    (folder / "folder").mkdir(parents=True)
    (folder / "plan.yaml").write_text("name: a\ndatasets: [a-b]\nalgorithms: [bc]\nseeds: 1\n")
    (folder / "own.yaml").write_text("batch_size: 7\n")
    return folder


def check_options(case: Case, options: Mapping[str, Any]) -> set[str]:
    """Options that have an effect in a case; fails where one has none and is not refused."""
    assert case.idle.keys() <= options.keys()
    base, used = run(case), set[str]()
    for option, parameter in options.items():
        if option in case.line.split():
            used.add(option)
        extra = sample_of(case, option, parameter)
        if option in case.idle or (extra[0] in case.line.split() and parameter.is_flag):
            continue
        code, output = run(case, *extra)
        is_refused = code in (1, 2) and option in output and "Traceback" not in output
        assert (code, output) != base or is_refused, f"{case.line} ignores {' '.join(extra)}"
        assert is_refused or code == base[0] or "Error" not in output, (extra, output)
        if (code, output) != base and code == base[0]:
            used.add(option)
    return used
