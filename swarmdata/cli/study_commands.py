"""`swarmdata study`: runs a grid of algorithms, datasets and seeds; `study-pages`: its answers."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse_all_but

Out = Annotated[
    Path | None, typer.Option(help="folder for tables, figures and text; NAME, beside the plan")
]


Plan = Annotated[
    Path,
    typer.Argument(
        metavar="STUDY.yaml|FOLDER",
        help="plan of the study; or its folder, to write its pages again",
    ),
]
Work = Annotated[Path | None, typer.Option(help="folder for runs; runs/study-NAME")]
Processes = Annotated[int, typer.Option(min=1, help="number of processes, one thread each")]
Only = Annotated[
    str | None, typer.Option(metavar="PATTERN", help="run only matching cells, such as 'bc/*'")
]
Check = Annotated[
    str | None, typer.Option(metavar="CELL", help="rerun a finished cell and compare results")
]


def study(
    context: typer.Context,
    file: Plan,
    out: Out = None,
    work: Work = None,
    workers: Processes = 2,
    only: Only = None,
    again: Annotated[bool, typer.Option(help="rerun cells of another configuration")] = False,
    check: Check = None,
) -> None:
    """Run a grid of algorithms, datasets and seeds.

    Writes tables, figures and text about it. An interrupted study resumes: run the same command
    again. With the folder of a study, its pages are written again from the episodes in it.
    """
    _require_extras("running a study")
    from swarmdata.evaluation.study.plan import Study
    from swarmdata.evaluation.study.run_study import StudyOptions, reproduce_study_cell, run_study

    if file.is_dir():
        refuse_all_but(context, (), "with a finished study's folder; pass the plan to run cells")
        from swarmdata.evaluation.study.pages.study_folder import rewrite_pages

        typer.echo(rewrite_pages(file)[0])
        return
    if check is not None:
        refuse_all_but(context, ("check", "work"), "with --check")
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
