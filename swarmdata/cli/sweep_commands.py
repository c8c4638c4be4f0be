"""`swarmdata sweep`: trained policies under worse communication and sensing."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import Episodes, Task

_AXIS = "NAME=A..B|A,B,..."


def sweep(
    context: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...", help="run folders, tiers, or datasets of trained policies"
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for results, tables and figures")],
    communication: Annotated[
        list[str] | None,
        typer.Option(metavar=_AXIS, help="such as drop=0..0.8 or bandwidth=3,2,1; may be repeated"),
    ] = None,
    observation: Annotated[
        list[str] | None,
        typer.Option(metavar=_AXIS, help="such as noise=0..0.2 or range=2..0.5; may be repeated"),
    ] = None,
    points: Annotated[
        int, typer.Option(min=2, help="number of values from A to B, both included")
    ] = 5,
    episodes: Episodes = 200,
    task: Task = None,
) -> None:
    """Evaluate policies under worse communication or sensing.

    One parameter changes at a time; everything else is as in training, on the same seeds. An
    interrupted sweep resumes: run the same command again.
    """
    if not any(".." in text for text in [*(communication or []), *(observation or [])]):
        refuse(context, ("points",), "without an axis such as noise=0..0.2")
    from swarmdata.evaluation.robustness.sweep import sweep as run_sweep
    from swarmdata.evaluation.robustness.sweep_axes import parse_axis

    axes = [parse_axis(text, "communication", points) for text in communication or []]
    axes += [parse_axis(text, "observation", points) for text in observation or []]
    run_sweep(targets, axes, out, n_episodes=episodes, task=task)
    typer.echo((out / "sweep.md").read_text(encoding="utf-8"), nl=False)
    for axis in axes:
        typer.echo(out / f"{axis.part}-{axis.name}.png")
