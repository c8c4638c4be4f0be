"""`swarmdata transfer`: policies in another simulator."""

from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.option_use import refuse_workers
from swarmdata.cli.shared_options import Engine, Episodes, Processes


def transfer(
    context: typer.Context,
    targets: Annotated[
        list[str], typer.Argument(metavar="TARGET...", help="policies, tiers or run folders")
    ],
    tasks: Annotated[
        list[str],
        typer.Option("--task", help="task of all targets: a preset, or a spec; may be repeated"),
    ],
    results: Annotated[Path, typer.Option(help="folder for result files")],
    out: Annotated[Path, typer.Option(help="Markdown file to write")],
    backend: Annotated[
        str, typer.Option(help="the other simulator: mujoco (an extra), kinematic or pymunk")
    ] = "mujoco",
    episodes: Episodes = 200,
    workers: Processes = 1,
    engine: Engine = "local",
) -> None:
    """Compare policies in two simulators, and write a page of tables.

    Policies act as they are, on the same seeds and layouts. An interrupted comparison resumes: run
    the same command again. Text that stands above the made part of the page is kept.
    """
    refuse_workers(context, engine)
    from swarmdata.drawing.page_text import page_with
    from swarmdata.evaluation.transfer import simulator_transfer
    from swarmdata.evaluation.transfer.transfer_page import transfer_page
    from swarmdata.store import write_file

    planned = simulator_transfer.plan_transfer(
        targets, tasks, results, backend=backend, n_episodes=episodes
    )
    teams = simulator_transfer.run_transfer(planned, engine=engine, workers=workers)
    out.parent.mkdir(parents=True, exist_ok=True)
    page = page_with(transfer_page(teams), out, "Do policies depend on the simulator?")
    write_file(out, page.encode())
    typer.echo(out)
