"""The command line: reads arguments, calls the library, prints what it returns."""

import json
import os
import select
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from swarmdata import __version__
from swarmdata.cli import (
    audit_commands,
    convert_commands,
    editing_commands,
    integrity_commands,
    ranking_commands,
    remote_commands,
    result_commands,
    study_commands,
    sweep_commands,
    training_commands,
)
from swarmdata.cli.record_commands import record_app
from swarmdata.cli.registry_commands import registry_app
from swarmdata.cli.task_commands import Communication, Observation, task_app
from swarmdata.errors import SwarmdataError


class _Group(TyperGroup):
    """Turns errors that users can act on into one message, and Ctrl-C into exit code 130."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except SwarmdataError as error:
            typer.echo(f"{type(error).__name__}: {error}", err=True)
            raise typer.Exit(1) from None
        except OSError as error:
            if isinstance(error, BrokenPipeError) and _is_output_closed():
                raise typer.Exit(CLOSED_PIPE) from None
            typer.echo(f"{type(error).__name__}: {_words(error)}", err=True)
            raise typer.Exit(1) from None
        except KeyboardInterrupt:
            typer.echo("Stopped. Run the same command again to go on from here.", err=True)
            raise typer.Exit(130) from None


app = typer.Typer(
    cls=_Group,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Offline multi-agent RL datasets for multi-robot tasks.",
)
app.add_typer(task_app, name="task")
app.add_typer(registry_app, name="registry")
app.add_typer(remote_commands.remote_app, name="remote")
app.add_typer(record_app, name="record")

DatasetId = Annotated[str, typer.Argument(metavar="ID", help="such as coop_nav-medium-mini")]
IdOrPath = Annotated[str, typer.Argument(metavar="ID_OR_PATH", help="an id, or a dataset's folder")]
Workers = Annotated[int | None, typer.Option(min=1, help="processes; default one per core")]
Episodes = Annotated[int, typer.Option(min=1, help="reserved evaluation seeds to use")]
Task = Annotated[str, typer.Option(help="of policies and tiers: a preset, or a spec's file")]


CLOSED_PIPE = 128 + 13
"""Exit code where nobody reads the output any more, as of programs that SIGPIPE ends."""


def main() -> None:
    """Runs the command line."""
    try:
        try:
            app()
        except SystemExit:
            if _is_output_closed():
                raise SystemExit(CLOSED_PIPE) from None
            if sys.stdout is not None:
                sys.stdout.flush()  # here, not at Python's end, where nobody says what failed
            raise
    except OSError as error:
        _discard_output()
        typer.echo(f"the output could not be written: {_words(error)}", err=True)
        raise SystemExit(1) from None


def _is_output_closed() -> bool:
    """Whether standard output is a pipe that nobody reads any more; what is left of it is lost."""
    if sys.__stdout__ is None:
        return False
    poll = select.poll()
    poll.register(sys.__stdout__, 0)
    if not any(event & select.POLLERR for _, event in poll.poll(0)):
        return False
    _discard_output()
    return True


def _discard_output() -> None:
    if sys.__stdout__ is not None:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.__stdout__.fileno())
        os.close(nowhere)


def _words(error: OSError) -> str:
    """What the system said, and of which file; names that no system takes are cut."""
    if error.strerror is None:
        return str(error)
    name = "" if error.filename is None else f": {str(error.filename)!r}"
    cut = f"{name[:120]}… ({len(str(error.filename))} characters)" if len(name) > 300 else name
    return f"{error.strerror}{cut}"


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"swarmdata {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True)
    ] = False,
) -> None:
    pass


@app.command("list")
def list_command() -> None:
    """Show every dataset."""
    from swarmdata.hub.catalog.catalog import list_datasets

    line = "{:36} {:>7} {:>12} {:>10} {:>8} {:>8}"
    typer.echo(line.format("id", "robots", "joint steps", "size", "score", "cached"))
    for info in list_datasets():
        size = f"{info.n_bytes / 1e6:.0f} MB" if info.n_bytes else "unknown"
        cached = "yes" if info.is_cached else "no"
        score = "unknown" if info.score is None else f"{info.score:.1f}"
        typer.echo(line.format(info.id, info.n_agents, f"{info.n_steps:,}", size, score, cached))


@app.command()
def info(dataset: DatasetId) -> None:
    """Show where a dataset is, its published digest and its recipe."""
    from swarmdata.behavior_policies.tiers import find_recipe
    from swarmdata.hub.catalog.catalog import dataset_folder, list_datasets

    recipe = find_recipe(dataset)
    entry = next(entry for entry in list_datasets() if entry.id == recipe.id)
    typer.echo(f"folder: {dataset_folder(recipe)}{'' if entry.is_cached else ' (not built yet)'}")
    typer.echo(f"published digest: {entry.digest or 'none'}")
    typer.echo(recipe.to_yaml(), nl=False)


@app.command()
def generate(
    dataset: Annotated[str, typer.Argument(metavar="ID_OR_RECIPE", help="an id or a recipe file")],
    steps: Annotated[int | None, typer.Option(min=1, help="other number of joint steps")] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option(help="the dataset's folder; default the cache")
    ] = None,
) -> None:
    """Build a dataset; run again after any interruption to go on."""
    from swarmdata.behavior_policies.tiers import find_recipe
    from swarmdata.building.build import build
    from swarmdata.hub.catalog.catalog import dataset_folder
    from swarmdata.specs.recipe import Recipe
    from swarmdata.store import read_manifest

    is_file = Path(dataset).suffix in (".json", ".yaml", ".yml")
    if out is None and (is_file or steps is not None):
        raise typer.BadParameter("needed for a recipe file and with --steps", param_hint="--out")
    if is_file and not Path(dataset).exists():
        raise typer.BadParameter(f"there is no file {dataset}")
    recipe = Recipe.from_file(Path(dataset)) if is_file else find_recipe(dataset)
    if steps is not None:
        recipe = Recipe.parse({**recipe.model_dump(), "n_steps": steps})
    folder = build(recipe, out or dataset_folder(recipe), workers=workers)
    manifest = read_manifest(folder)
    typer.echo(f"{folder}\n{manifest.n_steps:,} joint steps, digest {manifest.digest}")


def _folder(dataset: str) -> Path:
    """The folder of an id in the cache, or the path itself."""
    from swarmdata.hub.catalog.catalog import find_folder

    return find_folder(dataset)


app.command()(integrity_commands.verify)


@app.command()
def card(
    dataset: IdOrPath,
    write: Annotated[bool, typer.Option(help="replace the card in the dataset's folder")] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for ID.md and its picture ID.png")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="with --out: draw the picture")] = True,
) -> None:
    """Render a dataset's card from its files: print it, or with --out write it with its picture."""
    from swarmdata.cards.card import card_of, write_card
    from swarmdata.cards.publish import publish_card

    folder = _folder(dataset)
    if out is None:
        typer.echo(card_of(folder), nl=False)
    else:
        for path in publish_card(folder, out, pictures=pictures):
            typer.echo(path)
    if write:
        write_card(folder)


app.command()(audit_commands.audit)
app.command("filter")(editing_commands.filter_command)
app.command("combine")(editing_commands.combine_command)
app.command("subsample")(editing_commands.subsample_command)
app.command()(remote_commands.push)
app.command()(remote_commands.pull)
app.command()(training_commands.train)
app.command()(training_commands.ship)
app.command()(training_commands.learning)
app.command()(ranking_commands.rank)
app.command()(convert_commands.convert)
app.command()(result_commands.evaluate)
app.command()(result_commands.report)
app.command()(study_commands.study)
app.command()(sweep_commands.sweep)


@app.command()
def curves(
    files: Annotated[list[Path], typer.Argument(metavar="CSV...", help="curves of online runs")],
    out: Annotated[Path, typer.Option(help="the picture: .png, .svg or .pdf")],
    metric: Annotated[str, typer.Option(help="column to draw, without --by")] = "success",
    by: Annotated[
        str | None,
        typer.Option(
            metavar="PATTERN",
            help="how files are named, from the end: algorithm/task, task-algorithm/*; draws "
            "success and return by task, a line per algorithm with the interval over its runs",
        ),
    ] = None,
    log: Annotated[bool, typer.Option(help="with --by: logarithmic joint steps")] = False,
) -> None:
    """Draw training curves of online runs."""
    from swarmdata.evaluation.results.report import draw_learning, draw_training

    if by is None:
        draw_training(files, metric, out)
    else:
        draw_learning(files, by, out, log=log)
    typer.echo(out)


@app.command()
def render(
    target: Annotated[str, typer.Argument(help="a policy, tier, run folder or dataset id")],
    out: Annotated[Path, typer.Option(help="the .gif, .mp4 or .png file")],
    episode: Annotated[int, typer.Option(min=0, help="evaluation seed, or recorded episode")] = 0,
    task: Task = "coop_nav",
    observation: Observation = None,
    communication: Communication = None,
) -> None:
    """Draw one episode: a fresh one of a policy, or a recorded one of a dataset."""
    from swarmdata.evaluation.results.report import draw_target

    draw_target(target, out, episode, task, observation, communication)
    typer.echo(out)


@app.command()
def references(
    tasks: Annotated[
        list[str], typer.Argument(metavar="TASK...", help="presets such as coop_nav, or spec files")
    ],
    episodes: Episodes = 1000,
    out: Annotated[
        Path | None, typer.Option(help="JSON file in which to replace these tasks")
    ] = None,
) -> None:
    """Measure the reference policies of tasks again (cards/references.json)."""
    from swarmdata.evaluation.results.policy_names import measure_references

    for task in tasks:
        table = measure_references(task, episodes)
        _update(out, {Path(task).stem: table.model_dump(mode="json")})


def _update(path: Path | None, entries: dict[str, Any]) -> None:
    """Prints the entries, or puts them into a JSON file."""
    from swarmdata.hub.publishing.regenerate import put_entries

    if path is None:
        typer.echo(json.dumps(entries, indent=1, sort_keys=True, allow_nan=False))
    else:
        put_entries(path, entries)
