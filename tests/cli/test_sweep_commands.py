"""`swarmdata sweep`: what it prints, and one clear message where there is nothing to measure."""

from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="a sweep has figures")

from swarmdata.evaluation.results.result_files import load_result
from swarmdata.numerics.random import block_seeds
from tests.support import command_line
from tests.support.drawn import save_empty_figures

run = partial(command_line.run, "sweep")


@pytest.fixture(autouse=True)
def empty_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The figures of sweeps have tests of their own."""
    save_empty_figures(monkeypatch)


def test_a_tier_is_swept(tmp_path: Path) -> None:
    axes = ("--observation", "dropout=0..0.5", "--values", "2", "--episodes", "1")
    output = run("coop_nav-narrow", *axes, "--validation", "--out", tmp_path / "out")
    (file, *_) = (tmp_path / "out" / "results" / "trained").glob("*.json")
    seeds = load_result(file).evaluation.seeds
    assert seeds.tolist() == block_seeds("validation", 1).tolist()
    assert "the same 1 validation seeds" in output
    assert "| coop_nav-narrow, dropout 0 (as trained) |" in output
    assert output.endswith(f"{tmp_path}/out/observation-dropout.png\n")
    assert (tmp_path / "out" / "sweep.md").read_text() in output


@pytest.mark.slow
def test_bodies_are_swept_in_another_simulator(tmp_path: Path) -> None:
    """A scripted team, too: worse sensors do not concern it, and a slower body does."""
    axes = ("--body", "max_speed=0.6,0.2", "--episodes", "1", "--backend", "kinematic")
    output = run("scripted", *axes, "--out", tmp_path / "out")
    assert "| scripted, max_speed 0.6 (not varied) |" in output
    assert "| scripted, max_speed 0.2 |" in output
    assert output.endswith(f"{tmp_path}/out/body-max_speed.png\n")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("expert",), "SpecError: there is nothing to sweep. Pass at least one axis"),
        (("expret", "--observation", "noise=0..1"), "Did you mean 'expert'"),
    ],
)
def test_mistakes_are_one_message(arguments: tuple[str, ...], message: str, tmp_path: Path) -> None:
    output = run(*arguments, "--out", tmp_path / "out", code=1)
    assert message in output
    assert "Traceback" not in output
    assert not (tmp_path / "out").exists()
