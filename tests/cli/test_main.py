"""The command line: what it prints, and its exit codes."""

import json
import runpy
import signal
import subprocess
import sys
import time
import warnings
from importlib.util import find_spec
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner

from swarmdata import __version__
from swarmdata.building.parts_folder import build_folder
from swarmdata.cli import main
from swarmdata.cli.main import MAINTENANCE, SECTIONS, app
from swarmdata.registry.components import OFFLINE_ALGORITHMS, ONLINE_ALGORITHMS
from swarmdata.registry.presets import preset, preset_names
from swarmdata.specs.model_choice import with_models
from swarmdata.specs.task_spec import TaskSpec
from tests.support.command_line import run
from tests.support.tiny import TINY

pytestmark = pytest.mark.usefixtures("one_process")

COMMAND = [
    sys.executable,
    "-c",
    f"import sys; sys.path[:] = {sys.path!r}; from swarmdata.cli.main import main; main()",
]


@pytest.fixture
def recipe_file(tmp_path: Path) -> Path:
    path = tmp_path / "recipe.yaml"
    path.write_text(TINY.model_copy(update={"policies": TINY.policies[:1]}).to_yaml())
    return path


def test_version_and_list() -> None:
    assert run("--version") == f"swarmdata {__version__}\n"
    assert "coop_nav-random-mini-v1" in run("list")


def test_the_package_runs_as_a_module(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["swarmdata", "--version"])
    monkeypatch.delitem(sys.modules, "swarmdata.__main__", raising=False)  # others may import it
    with pytest.raises(SystemExit, match="0"):
        runpy.run_module("swarmdata", run_name="__main__")
    assert capsys.readouterr().out == f"swarmdata {__version__}\n"


def test_info_shows_the_recipe_and_builds_nothing(cache_folder: Path) -> None:
    output = run("info", "coop_nav-random-mini")

    assert "not in the cache" in output
    assert "n_steps: 50000" in output
    assert not list(cache_folder.iterdir())


def test_error_of_the_library_is_one_message_and_code_1() -> None:
    output = run("info", "coop_nav-rando", code=1)

    assert output.startswith("UnknownNameError: unknown dataset 'coop_nav-rando'. Did you mean")
    assert "Traceback" not in output


@pytest.mark.parametrize(
    "arguments",
    [
        ("nonsense",),
        ("info",),
        ("generate", "coop_nav-random", "--steps", "5"),
        ("generate", "absent.yaml", "--out", "x"),
        pytest.param(
            ("train", "bc", "x", "--out", "y", "--set", "a"),
            marks=pytest.mark.skipif(not find_spec("torch"), reason="algorithms need torch"),
        ),
    ],
)
def test_wrong_usage_is_code_2(arguments: tuple[str, ...]) -> None:
    run(*arguments, code=2)


def test_a_recipe_of_an_edit_is_not_generated(tmp_path: Path) -> None:
    file = tmp_path / "recipe.json"
    file.write_text('{"kind": "edit", "id": "coop_nav-x-v0"}')
    printed = run("generate", file, "--out", tmp_path / "x", code=1)
    assert "is of a dataset of the kind 'edit', which is not simulated" in printed


def test_generate_verify_card(recipe_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    output = run("generate", recipe_file, "--out", out, "--workers", "1", "--steps", "500")

    assert "520 joint steps" in output
    assert "all files match the manifest" in run("verify", out)
    assert run("card", out) == (out / "card.md").read_text()
    cards = tmp_path / "cards"
    assert run("card", out, "--out", cards, "--no-pictures") == f"{cards}/coop_nav-tiny-v0.md\n"
    assert (cards / "coop_nav-tiny-v0.md").read_text() == (out / "card.md").read_text()

    data = out / "data.zarr" / "rewards" / "c.0.0"
    damaged = bytearray(data.read_bytes())
    damaged[100] ^= 1
    data.write_bytes(damaged)
    (out / "data.zarr" / "states" / "zarr.json").unlink()
    output = run("verify", out, code=1)
    assert f"{data}: was changed: 1 of 1 chunks are bad, the first is chunk 0 (rows 0 to" in output
    assert f"{out}/data.zarr/states/zarr.json: is absent" in output
    assert f"2 broken files; `swarmdata verify {out} --repair` replaces them" in output
    output = run("verify", out, "--repair", "--replay", "2", "--workers", "1")
    assert f"{data}: made again from the recipe" in output
    assert "simulated 2 episodes again: all bits are equal" in output
    assert run("verify", out).startswith(f"{out}: all files match the manifest")


def test_evaluate_and_report(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report has pictures")
    results, out = tmp_path / "results", tmp_path / "out"
    command = ("evaluate", "idle", "random", "coop_nav-random", "--episodes", "4", "--out", results)
    table = run(*command)

    spec = preset("coop_nav").hash()[:8]
    names = {path.name for path in results.iterdir()}
    assert names == {f"{who}--{spec}-0.json" for who in ("idle", "random", "coop_nav-random")}
    assert "idle" in table
    assert "already" not in table
    assert "3 of 3 results were already in" in run(*command)
    assert "already" not in run(*command, "--again")
    assert "4 episodes of coop_nav" in run("report", results, "--out", out, "--figures", "svg")
    tables = {f"table{ending}" for ending in (".md", ".csv", ".tex", ".svg")}
    others = {"report.md", "runs.csv", "marl-eval.json", "pareto.svg", ".swarmdata-files.json"}
    assert {path.name for path in out.iterdir()} == tables | others
    assert "holds no results" in run("report", out / "no", "--out", out, code=1)


def test_a_target_may_be_named(tmp_path: Path) -> None:
    results = tmp_path / "results"
    assert "still" in run(
        "evaluate", "idle", "--episodes", "2", "--out", results, "--label", "still"
    )
    (file,) = results.iterdir()
    assert file.name.startswith("still--")
    wrong = run("evaluate", "idle", "--episodes", "2", "--label", "a/b", code=1)
    assert wrong.startswith("SpecError")


def test_results_say_their_models_and_the_report_finds_them(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="the report has pictures")
    results, out = tmp_path / "results", tmp_path / "out"
    models = ("--observation", "lidar-8", "--communication", "lossy-30")
    title = "observation lidar (n_rays 8), communication broadcast (drop_probability 0.3)"

    assert title in run("evaluate", "idle", "--episodes", "2", "--out", results, *models)
    (file,) = results.iterdir()
    spec = json.loads(file.read_text())["spec"]
    assert spec["observation"]["n_rays"] == 8
    assert spec["communication"]["drop_probability"] == 0.3
    assert title in run("report", results, "--out", out, "--figures", "svg")
    assert title in (out / "table.md").read_text()

    run("evaluate", "random", "--episodes", "2", "--out", results)
    assert "measured under other models" in run("report", results, "--out", out, code=1)


def test_tasks_are_presets_or_files(tmp_path: Path) -> None:
    file = tmp_path / "short.yaml"
    file.write_text("horizon: 12")

    assert "unsolved episode as 1.2 s" in run("evaluate", "idle", "--episodes", "2", "--task", file)
    printed = CliRunner().invoke(app, ["references", str(file), "--episodes", "2"]).stdout
    assert list(json.loads(printed)) == ["short"]  # apart from notes of kernels, on standard error
    assert "unknown task 'coop_nv'" in run("evaluate", "idle", "--task", "coop_nv", code=1)


def test_info_takes_folders_and_datasets_of_the_cache(
    recipe_file: Path, tmp_path: Path, cache_folder: Path
) -> None:
    out = tmp_path / "data"
    run("generate", recipe_file, "--out", out, "--workers", "1")
    text = run("info", out)
    assert f"folder: {out}" in text
    assert "nothing to compare it with" in text
    assert "name: random" in text
    (cache_folder / "datasets").mkdir(exist_ok=True)
    out.rename(cache_folder / "datasets" / "coop_nav-tiny-v0")
    assert "name: random" in run("info", "coop_nav-tiny-v0")
    assert "there is no dataset folder at data/absent" in run("info", "data/absent", code=1)


def test_own_datasets_are_listed_and_named_where_an_id_is_unknown(
    recipe_file: Path, cache_folder: Path
) -> None:
    run("generate", recipe_file, "--out", cache_folder / "datasets" / "coop_nav-tiny-v0")
    (own,) = [line for line in run("list").splitlines() if line.startswith("coop_nav-tiny-v0 ")]
    assert own.split()[1] == "4"
    assert own.split()[-2:] == ["unknown", "yes"]
    assert "Did you mean 'coop_nav-tiny'?" in run("info", "coop_nav-tny", code=1)


def test_values_of_options_say_got_and_expected() -> None:
    text = run("train", "bc", "coop_nav-medium", "--updates", "many", "--out", "x", code=2)
    assert "'--updates': got 'many', expected a whole number" in " ".join(text.split())


def test_help_lists_every_command_in_a_section() -> None:
    text = run("--help")
    shown = [title for title in SECTIONS if title != MAINTENANCE]
    places = [text.index(f"{title}:") for title in shown]
    assert places == sorted(places)
    listed = [name for names in SECTIONS.values() for name in names]
    assert len(set(listed)) == len(listed)
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert commands.keys() <= set(listed)
    for title, names in SECTIONS.items():
        for name in names:
            assert (f"\n  {name} " in text) is (title in shown), name
    assert text.count("...\n") == 1, "a line of help is cut"  # `COMMAND [ARGS]...` is none
    assert "\n  table " not in run("task", "--help")


def test_help_lists_options_by_case() -> None:
    text = run("generate", "--help")
    places = [text.index(f"\n{title}\n") for title in ("Arguments:", "Options:", "With --task:")]
    assert places == sorted(places)
    assert text.index("\n  --noise ") > places[2] > text.index("\n  --steps ")
    assert "with --task: " not in text
    assert {"With --to:", "With --from:"} <= set(run("convert", "--help").splitlines())


def test_task_list_shows_every_preset() -> None:
    lines = run("task", "list").splitlines()

    assert [line.split()[0] for line in lines] == ["name", *preset_names()]
    (headline,) = (line for line in lines if line.startswith("coop_nav "))
    assert "4 x 4" in headline
    assert "headline task" in headline


def test_task_table_writes_the_pages_of_worlds(tmp_path: Path) -> None:
    run("task", "table", "--out", tmp_path / "worlds")
    committed = Path(__file__).parents[2] / "docs/worlds"
    for page in committed.iterdir():
        assert (tmp_path / "worlds" / page.name).read_bytes() == page.read_bytes()


def test_task_show_prints_a_spec_that_validates(tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    file.write_text(run("task", "show", "coop_nav"))

    assert TaskSpec.from_file(file) == TaskSpec()
    assert run("task", "validate", file).startswith("OK: coop_nav with 4 robots, observation state")
    models = ("--observation", "lidar-8", "--communication", "lossy-30")
    text = CliRunner().invoke(app, ["task", "show", "coop_nav", *models]).stdout
    assert TaskSpec.from_text(text) == with_models(preset("coop_nav"), "lidar-8", "lossy-30")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("horizn: 3", "unknown key. Did you mean 'horizon'"),
        ("arena: {width: 0.3, height: 0.3}", "8 of 8 layouts could not be drawn"),
        (
            "{horizon: 0, team: [{count: 2, robot: {radius: -1}}], arena: {width: x}}",
            "team.0.robot.radius: expected at least 0.001 (got -1); arena.width: expected a number "
            "(got 'x'); horizon: expected at least 1 (got 0)",
        ),
        (None, "cannot read a spec from"),
    ],
)
def test_task_validate_gives_the_one_error(tmp_path: Path, text: str | None, message: str) -> None:
    file = tmp_path / "bad.yaml"
    if text is not None:
        file.write_text(text)
    output = run("task", "validate", file, code=1)

    assert message in output
    assert "Traceback" not in output


@pytest.mark.slow
def test_task_play_draws(tmp_path: Path) -> None:
    pytest.importorskip("PIL", reason="Pillow draws")
    models = ("--observation", "lidar", "--communication", "lossy-30")
    for name, options in {"a.png": (), "b.png": models, "c.gif": models}.items():
        output = run("task", "play", "coop_nav", "--out", tmp_path / name, *options)
        assert "ended by success" in output
        assert (tmp_path / name).stat().st_size > 2000
    assert (tmp_path / "a.png").read_bytes() != (tmp_path / "b.png").read_bytes()
    assert "ends in" in run("task", "play", "coop_nav", "--out", tmp_path / "x.bmp", code=1)


def test_warnings_are_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the place in the code, which says nothing to users."""
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    monkeypatch.setattr(main, "app", lambda: None)
    main.main()
    assert warnings.formatwarning("x", UserWarning, "code.py", 3) == "UserWarning: x\n"


def test_interrupt_is_code_130_and_says_how_to_go_on(recipe_file: Path, tmp_path: Path) -> None:
    out = tmp_path / "data"
    process = subprocess.Popen(
        [*COMMAND, "generate", str(recipe_file), "--out", str(out), "--steps", "400000"],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a shell starts background jobs with the interrupt ignored, and children inherit that
        preexec_fn=lambda: signal.signal(  # noqa: PLW1509 (this test has no threads)
            signal.SIGINT, signal.default_int_handler
        ),
    )
    while process.poll() is None and not build_folder(out).exists():
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, stderr = process.communicate(timeout=300)

    assert process.returncode == 130, stderr
    assert stderr.endswith("Stopped. Run the same command again to resume.\n")
    assert "Traceback" not in stderr


def test_the_algorithms_are_listed_without_torch() -> None:
    code = (
        "import sys; sys.modules['torch'] = None\n"
        "from swarmdata.cli.main import app\napp(['algorithms'])"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.splitlines()
    names = [tuple(line.split()[:2]) for line in found]
    assert names == [
        *((name, "offline") for name in OFFLINE_ALGORITHMS),
        *((name, "online") for name in ONLINE_ALGORITHMS),
    ]
    assert all(len(line.split(maxsplit=2)) == 3 for line in found), "each has a summary"
