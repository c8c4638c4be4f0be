"""Every code block of README.md and docs/ works: Python and commands run, files are valid.

A block that cannot run says why in a comment on the line before it: `<!-- not run: REASON -->`.
Python blocks of a page run in order, in one namespace and an empty folder. Every command is parsed
by the real command line, and `EXECUTED` run as well.
"""

import contextlib
import re
import shlex
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import pytest
import typer
import yaml
from typer.testing import CliRunner

from swarmdata.cli.main import app
from swarmdata.evaluation.study.plan import Study
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec
from tests.support.own_task import nothing_registered

ROOT = Path(__file__).parents[2]
DOCUMENTS = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", ".github/pull_request_template.md")),
    *sorted((ROOT / "docs").rglob("*.md")),
]
MINI = "coop_nav-medium-mini"

FENCE = re.compile(
    r"^(?:<!-- not run: (?P<reason>.+?) -->\n\n?)?```(?P<language>\S*)\n(?P<text>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
COMMAND = re.compile(r"^    swarmdata ((?:.*\\\n)*.*)", re.MULTILINE)

NEEDS = {
    "docs/extending.md": "torch",
    "docs/other-software.md": "torchrl",
    "docs/tutorials/another-environment.md": "mpe2",
    "docs/tutorials/first-steps.md": "torch",
    "docs/tutorials/own-task.md": "torch",
    "docs/tutorials/real-robots.md": "torch",
    "docs/your-data.md": "mpe2",
}
"""A library that a page needs beside the package."""

EXECUTED = {
    "docs/datasets.md": {"list", "info"},
    "docs/tasks.md": {"task list", "task show", "task validate"},
    "docs/remotes.md": {"remote list", "remote add", "remote remove"},
}
"""Commands that are quick and need no arrays, by page; they run in every test run."""

EXECUTED_ON_DATA = {
    "docs/catalogue.md": {f"catalogue build {MINI} --observation lidar --communication lossy-30"},
    "docs/generating.md": {f"audit {MINI}", "filter", "combine", "subsample"},
    "docs/remotes.md": {f"verify {MINI}"},
    "docs/your-data.md": {"convert"},
}
"""Commands that need a mini, by page: names, or whole lines."""

PLAIN = ("bibtex",)
"""Languages of blocks that nothing runs."""


class Block(NamedTuple):
    """A fenced block of a page."""

    language: str
    text: str
    line: int  # of its first line, from 0
    reason: str | None  # why it is not run


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path) -> Iterator[Block]:
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        line = text[: found.start("text")].count("\n")
        yield Block(found["language"], found["text"], line, found["reason"])


def python_of(page: Path) -> list[Block]:
    return [each for each in blocks(page) if each.language == "python" and not each.reason]


def commands_of(page: Path) -> list[str]:
    """The commands of a page, one line each, without comments."""
    found = COMMAND.findall(page.read_text(encoding="utf-8"))
    return [re.sub(r"\s+#.*", "", line.replace("\\\n", " ")).strip() for line in found]


@cache
def command_line() -> Any:
    """The whole command line, whose commands say their name instead of doing anything."""
    tree = typer.main.get_command(app)
    waiting: list[tuple[str, Any]] = [("", tree)]
    while waiting:
        name, command = waiting.pop()
        inner = getattr(command, "commands", None)
        if inner is None:
            command.callback = partial(_name, name.strip())
        else:
            waiting += [(f"{name} {word}", each) for word, each in inner.items()]
    return tree


def _name(command: str, /, *_: Any, **__: Any) -> str:
    return command


def parse(line: str) -> str:
    """The name of a command, which the command line has understood; raises as it does."""
    words = shlex.split(line.partition(" > ")[0])
    found: str = command_line().main(words, prog_name="swarmdata", standalone_mode=False)
    return found


def run(line: str, folder: Path) -> None:
    """Runs a command; `> FILE` is as in a shell."""
    words, _, file = line.partition(" > ")
    result = CliRunner().invoke(app, shlex.split(words))
    assert result.exit_code == 0, f"swarmdata {line}: {result.output}"
    if file:
        (folder / file).write_text(result.stdout, encoding="utf-8")


@pytest.fixture(scope="session")
def minis(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cache with the mini that most pages use, built once."""
    import swarmdata

    folder = tmp_path_factory.mktemp("minis")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SWARMDATA_CACHE", str(folder))
        swarmdata.load(MINI, progress=False)
    return folder


@pytest.fixture
def workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, and a configuration of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.delenv("SWARMDATA_REMOTES", raising=False)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    return tmp_path


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_blocks_have_a_language_that_is_tested_and_yaml_is_valid(page: Path) -> None:
    for block in blocks(page):
        assert block.language in ("python", "yaml", *PLAIN), f"{page.name}:{block.line}"
        if block.language == "yaml" and not block.reason:
            keys = yaml.safe_load(block.text)
            kinds: dict[str, type[Frozen]] = {"policies": Recipe, "datasets": Study, "each": LogMap}
            model: type[Frozen] = next((kinds[key] for key in kinds if key in keys), TaskSpec)
            model.from_text(block.text, f"{page.name}:{block.line}")


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_commands_are_understood(page: Path) -> None:
    for line in commands_of(page):
        assert parse(line)


@pytest.mark.parametrize("name", EXECUTED)
def test_quick_commands_run(name: str, workplace: Path) -> None:
    ran = set()
    for line in commands_of(ROOT / name):
        command = parse(line)
        if command in EXECUTED[name]:
            run(line, workplace)
            ran.add(command)
    assert ran == EXECUTED[name]


@pytest.mark.slow
@pytest.mark.parametrize("name", EXECUTED_ON_DATA)
def test_commands_on_data_run(
    name: str, workplace: Path, minis: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SWARMDATA_CACHE", str(minis))
    chosen, ran = EXECUTED_ON_DATA[name], set()
    for line in commands_of(ROOT / name):
        command = parse(line)
        if "--to minari" in line:
            pytest.importorskip("minari", reason="the page writes Minari's format")
        if found := chosen & {command, line}:
            run(line, workplace)
            ran |= found
    assert ran == chosen


@pytest.mark.slow
@pytest.mark.parametrize("page", [page for page in DOCUMENTS if python_of(page)], ids=name_of)
def test_python_blocks_run(
    page: Path, workplace: Path, minis: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The blocks of a page run one after the other in one namespace."""
    if library := NEEDS.get(name_of(page)):
        pytest.importorskip(library, reason=f"the page needs {library}")
    monkeypatch.setenv("SWARMDATA_CACHE", str(minis))
    monkeypatch.syspath_prepend(str(workplace))  # as for a script or notebook in the folder
    namespace: dict[str, Any] = {"__name__": page.stem}
    with contextlib.ExitStack() as stack:
        stack.callback(_close_figures)
        stack.enter_context(nothing_registered())
        for block in python_of(page):
            exec(compile("\n" * block.line + block.text, str(page), "exec"), namespace)


def _close_figures() -> None:
    with contextlib.suppress(ImportError):
        import matplotlib.pyplot as plt

        plt.close("all")


@pytest.mark.parametrize("page", DOCUMENTS, ids=name_of)
def test_other_commands_name_what_exists(page: Path) -> None:
    """Targets of `make`, and the scripts and modules that `python` runs."""
    text = page.read_text(encoding="utf-8")
    targets = re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for target in re.findall(r"^    make ([a-z]+)", text, re.MULTILINE):
        assert target in targets
    for module in re.findall(r"^    python -m ([\w.]+)", text, re.MULTILINE):
        assert (ROOT / (module.replace(".", "/") + ".py")).is_file(), module
    for script in re.findall(r"^    python ([\w./]+\.py)", text, re.MULTILINE):
        assert (ROOT / script).is_file(), script
