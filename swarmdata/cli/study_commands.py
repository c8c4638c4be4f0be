"""`swarmdata study`: runs a grid of algorithms, datasets and seeds."""

from pathlib import Path
from typing import Annotated

import typer


def study(
    file: Annotated[Path, typer.Argument(metavar="STUDY.yaml", help="plan of the study")],
    out: Annotated[
        Path | None,
        typer.Option(help="folder for tables, figures and text; default: NAME, beside the plan"),
    ] = None,
    work: Annotated[
        Path | None, typer.Option(help="folder for runs and results; default: runs/study-NAME")
    ] = None,
    workers: Annotated[int, typer.Option(min=1, help="number of processes, one thread each")] = 2,
    only: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="run only matching cells, such as 'bc/*'")
    ] = None,
    again: Annotated[
        bool, typer.Option(help="delete and rerun cells with another configuration")
    ] = False,
    check: Annotated[
        str | None,
        typer.Option(
            metavar="CELL",
            help="rerun a finished cell in a temporary folder and compare the results",
        ),
    ] = None,
) -> None:
    """Run a grid of algorithms, datasets and seeds.

    Writes tables, figures and text about it. An interrupted study resumes: run the same command
    again.
    """
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "running a study")
    require_extra("matplotlib", "plots", "drawing the figures of a study")
    from swarmdata.evaluation.study.plan import Study
    from swarmdata.evaluation.study.run_study import StudyOptions, reproduce_study_cell, run_study

    plan = Study.from_file(file)
    options = StudyOptions(out or file.parent / plan.name, work, workers, only, again)
    if check is not None:
        found = reproduce_study_cell(plan, check, options)
        typer.echo(found.sentence())
        raise typer.Exit(0 if found.is_same else 1)
    failures, written = run_study(plan, options, f"swarmdata study {file}")
    typer.echo(written[0])
    for name, reason in failures.items():
        typer.echo(f"failed: {name}: {reason}", err=True)
    raise typer.Exit(1 if failures else 0)
