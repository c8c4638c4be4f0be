"""`swarmdata study`: runs a grid of algorithms, datasets and seeds; `study-cards`: on cards."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmdata.cli.option_use import refuse, refuse_all_but, refuse_workers
from swarmdata.cli.shared_options import Engine

if TYPE_CHECKING:
    from swarmdata.evaluation.study.plan import Study
    from swarmdata.evaluation.study.run_study import StudyOptions


def study(
    context: typer.Context,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="STUDY.yaml|FOLDER",
            help="plan of the study; or its folder, to write its pages again",
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(help="folder for tables and figures; NAME, beside the plan")
    ] = None,
    work: Annotated[Path | None, typer.Option(help="folder for runs; runs/study-NAME")] = None,
    workers: Annotated[int, typer.Option(min=1, help="number of processes, one thread each")] = 2,
    engine: Engine = "local",
    only: Annotated[
        str | None, typer.Option(metavar="PATTERN", help="run only matching cells, such as 'bc/*'")
    ] = None,
    again: Annotated[bool, typer.Option(help="rerun cells of another configuration")] = False,
    check: Annotated[
        str | None, typer.Option(metavar="CELL", help="rerun a finished cell and compare results")
    ] = None,
    cells: Annotated[
        bool, typer.Option("--cells", help="list the cells, and which are done")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="with --cells: a line of JSON for each")
    ] = False,
    cell: Annotated[
        str | None, typer.Option(metavar="CELL", help="run this cell here; for schedulers")
    ] = None,
    collect: Annotated[
        bool, typer.Option("--collect", help="write the pages of finished cells, and run none")
    ] = False,
    shifts: Annotated[
        bool,
        typer.Option(
            "--shifts", help="only evaluate finished cells in the plan's other conditions"
        ),
    ] = False,
) -> None:
    """Run a grid of algorithms, datasets and seeds.

    Writes tables and figures. An interrupted study resumes: run the same command again. With the
    folder of a study, its page is written again from the episodes in it; text that stands above the
    made part of the page is kept.
    """
    from swarmdata.runtime.extras import require_extra

    require_extra("torch", "torch", "running a study")
    require_extra("matplotlib", "plots", "drawing the figures of a study")
    from swarmdata.evaluation.study import run_study
    from swarmdata.evaluation.study.pages.study_folder import rewrite_pages
    from swarmdata.evaluation.study.plan import Study

    if file.is_dir():
        refuse_all_but(context, (), "with a finished study's folder; pass the plan to run cells")
        typer.echo(rewrite_pages(file)[0])
        return
    refuse_workers(context, engine)
    plan, command = Study.from_file(file), f"swarmdata study {file}"
    folder = out or file.parent / plan.name
    options = run_study.StudyOptions(folder, work, workers, engine, only, shifts, again)
    if check is not None:
        refuse_all_but(context, ("check", "work"), "with --check")
        found = run_study.reproduce_study_cell(plan, check, options)
        typer.echo(found.sentence())
        raise typer.Exit(0 if found.is_same else 1)
    if cells:
        refuse_all_but(context, ("cells", "json", "work"), "with --cells")
        _list_cells(plan, options, as_json=json)
    elif cell is not None:
        refuse_all_but(context, ("cell", "work", "again"), "with --cell")
        is_new = run_study.run_one_cell(plan, cell, options)
        typer.echo(f"{cell}: {'done' if is_new else 'was done before'}")
    elif collect:
        refuse_all_but(context, ("collect", "work", "out"), "with --collect")
        typer.echo(run_study.collect_study(plan, options, command)[0])
    else:
        _run_all(context, plan, options, command)


def _list_cells(plan: "Study", options: "StudyOptions", *, as_json: bool) -> None:
    import json

    from swarmdata.evaluation.study.run_study import list_cells

    found = list_cells(plan, options)
    for label in found.open_sweeps:
        typer.echo(
            f"the cells of sweep {label} are chosen once those on {plan.sweeps[label].dataset} are "
            "done",
            err=True,
        )
    for cell in found.cells:
        done = cell.is_done(cell.folder(options.work_of(plan)))
        line = {"cell": cell.name, "done": done, "updates": cell.n_updates, "key": cell.key}
        typer.echo(json.dumps(line) if as_json else f"{'done' if done else 'open'}  {cell.name}")


def _run_all(context: typer.Context, plan: "Study", options: "StudyOptions", command: str) -> None:
    refuse(context, ("json",), "without --cells")
    if options.shifts_only:
        refuse(context, ("only",), "with --shifts")
    from swarmdata.evaluation.study.run_study import run_study

    failures, written = run_study(plan, options, command)
    typer.echo(written[0] if written else "no page yet: no cell on the study's datasets is done")
    for name, reason in failures.items():
        typer.echo(f"failed: {name}: {reason}", err=True)
    raise typer.Exit(1 if failures else 0)


def study_cards(
    studies: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="folder of finished studies")
    ] = Path("cards/studies"),
    cards: Annotated[Path, typer.Option(help="folder of the cards")] = Path("cards/published"),
) -> None:
    """Write reference scores and the results of finished studies on cards again."""
    from swarmdata.cards.committed_studies import read_studies
    from swarmdata.cards.publish import refresh_cards

    for card in refresh_cards(cards, read_studies(studies)):
        typer.echo(card)
