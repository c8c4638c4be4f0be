"""`swarmdata catalogue`: static pages on which datasets, episodes and results are looked at."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from swarmdata.cli.shared_options import Communication, Observation, Workers

catalogue_app = typer.Typer(
    no_args_is_help=True, help="Build and open pages of datasets, episodes, results."
)

Site = Annotated[Path, typer.Option(help="folder of the catalogue")]
Datasets = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[ID_OR_PATH]...",
        help="datasets to show; default: those in the cache, and pages of all published ones",
    ),
]
MostEpisodes = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="most episodes of a dataset, a sample of every policy and outcome",
        show_default="1000",
    ),
]
Minis = Annotated[bool, typer.Option("--minis", help="show all published minis")]
AllEpisodes = Annotated[bool, typer.Option("--all", help="show every episode instead of a sample")]
Results = Annotated[
    list[Path] | None,
    typer.Option(help="results to show: a study's folder, or one of `evaluate`; repeatable"),
]
Entries = Annotated[
    Path | None,
    typer.Option(help="folder of leaderboard entries, which are verified, to show the valid ones"),
]


@catalogue_app.command("build")
def build_command(
    datasets: Datasets = None,
    out: Site = Path("site"),
    minis: Minis = False,
    episodes: MostEpisodes = None,
    all_episodes: AllEpisodes = False,
    results: Results = None,
    entries: Entries = None,
    observation: Observation = None,
    communication: Communication = None,
    workers: Workers = None,
) -> None:
    """Write static pages of datasets, episodes and results, and print their sizes and times.

    Datasets that are named have pages, with the committed results on them; without names, all
    published datasets have. The pages need no server and no network. An earlier catalogue in the
    folder is replaced when the new one is complete.
    """
    from swarmdata.catalogue.build_catalogue import (
        DEFAULT_EPISODES,
        CatalogueChoices,
        build_catalogue,
    )
    from swarmdata.catalogue.entries import published_minis

    if minis and datasets:
        raise typer.BadParameter("cannot be combined with names of datasets", param_hint="--minis")
    if all_episodes and episodes is not None:
        raise typer.BadParameter("cannot be combined with --episodes", param_hint="--all")
    choices = CatalogueChoices(
        episodes=None if all_episodes else episodes or DEFAULT_EPISODES,
        results=tuple(results or ()),
        entries=entries,
        observation=observation,
        communication=communication,
        workers=workers,
        published=not datasets,
    )
    names = published_minis() if minis else datasets or ()
    note = partial(typer.echo, err=True)
    typer.echo(build_catalogue(names, out, choices, note=note))


@catalogue_app.command("open")
def open_command(out: Site = Path("site")) -> None:
    """Open a catalogue in the browser, and print its address."""
    import webbrowser

    from swarmdata.catalogue.site_folder import is_site
    from swarmdata.errors import DatasetNotFoundError

    if not is_site(out):
        raise DatasetNotFoundError(
            f"there is no catalogue at {out}. Build one with: swarmdata catalogue build --out {out}"
        )
    address = (out.resolve() / "index.html").as_uri()
    typer.echo(address)
    if not webbrowser.open(address):
        typer.echo("No browser could be started; open this address in one.", err=True)
