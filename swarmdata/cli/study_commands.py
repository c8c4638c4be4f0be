"""`swarmdata study`: runs a grid of algorithms, datasets and seeds; `study-pages`: its answers."""

from pathlib import Path
from typing import Annotated

import typer

Out = Annotated[
    Path | None, typer.Option(help="folder for tables, figures and text; NAME, beside the plan")
]


def study(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY.yaml|FOLDER",
            help="plan of the study; or its folder, to write its pages again",
        ),
    ],
    out: Out = None,
    work: Annotated[Path | None, typer.Option(help="folder for runs; runs/study-NAME")] = None,
    workers: Annotated[int, typer.Option(min=1, help="number of processes, one thread each")] = 2,
    only: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="run only matching cells, such as 'bc/*'")
    ] = None,
    again: Annotated[bool, typer.Option(help="rerun cells of another configuration")] = False,
    check: Annotated[
        str | None, typer.Option(metavar="CELL", help="rerun a finished cell and compare results")
    ] = None,
) -> None:
    """Run a grid of algorithms, datasets and seeds.

    Writes tables, figures and text about it. An interrupted study resumes: run the same command
    again. With the folder of a study, its pages are written again from the episodes in it.
    """
    _require_extras("running a study")
    from swarmdata.evaluation.study.plan import Study
    from swarmdata.evaluation.study.run_study import StudyOptions, reproduce_study_cell, run_study

    if file.is_dir():
        _write_again(file, out=out, work=work, only=only, check=check, again=again)
        return
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


def _require_extras(purpose: str) -> None:
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", purpose)
    require_extra("matplotlib", "plots", "drawing the figures of a study")


def _write_again(folder: Path, **given: object) -> None:
    """Writes the pages of a finished study again; options that would need cells are refused."""
    if unused := [f"--{name}" for name, value in given.items() if value]:
        raise typer.BadParameter(
            f"{folder} is a folder, whose pages are written again without running cells, so "
            f"{', '.join(unused)} cannot be used. Pass the plan instead."
        )
    from swarmdata.evaluation.study.pages.study_folder import rewrite_pages

    typer.echo(rewrite_pages(folder)[0])


def study_pages(
    studies: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="folder of finished studies")
    ] = Path("cards/studies"),
    out: Annotated[Path, typer.Option(help="folder for the pages")] = Path("docs/results"),
) -> None:
    """Write one page for each question that finished studies answer.

    Pages are computed from the episodes in the studies' folders; nothing is trained or loaded. A
    page that no study answers yet is not written, and the command says what it needs.
    """
    _require_extras("reading a study")
    from swarmdata.evaluation.study.answers.write_answers import write_answers

    pages, left_out = write_answers(studies, out)
    for page in pages:
        typer.echo(page)
    for name, reason in left_out.items():
        typer.echo(f"left out: {name}: {reason}", err=True)
