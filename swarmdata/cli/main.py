"""The command line: parses arguments, calls the library, prints the result."""

import json
import logging
import os
import re
import select
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from swarmdata import __version__
from swarmdata.cli import (
    integrity_commands,
    registry_commands,
    remote_commands,
    result_commands,
    study_commands,
    sweep_commands,
    training_commands,
)
from swarmdata.cli.catalogue_commands import catalogue_app
from swarmdata.cli.leaderboard_commands import leaderboard_app
from swarmdata.cli.making import (
    convert_commands,
    editing_commands,
    generate_commands,
    import_commands,
)
from swarmdata.cli.option_use import refuse
from swarmdata.cli.shared_options import (
    Backend,
    Clip,
    Communication,
    Episodes,
    IdOrPath,
    Observation,
    Task,
)
from swarmdata.cli.task_commands import task_app
from swarmdata.errors import SwarmdataError, printable


def _false_unless_given(option: Any) -> Any:
    """Gives the option `--help` the default False instead of None.

    Typer converts None with pydantic, whose import takes longer than to list all datasets; it takes
    a bool as it is.
    """
    if option is not None:
        option.default = False
    return option


class _Group(TyperGroup):
    """Turns expected errors into one-line messages, and Ctrl-C into exit code 130."""

    def get_help_option(self, ctx: Any) -> Any:
        return _false_unless_given(super().get_help_option(ctx))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Lists the commands in sections."""
        limit = formatter.width - 6 - max(map(len, self.commands))
        for title, names in SECTIONS.items():
            if title == MAINTENANCE:
                continue
            rows = [(name, self.commands[name].get_short_help_str(limit)) for name in names]
            with formatter.section(title):
                formatter.write_dl(rows)

    def invoke(self, ctx: Any) -> Any:
        try:
            with _shown_messages():
                return super().invoke(ctx)
        except typer.BadParameter as error:
            _reword(error)
            raise
        except SwarmdataError as error:
            typer.echo(f"{type(error).__name__}: {error}", err=True)
            raise typer.Exit(1) from None
        except OSError as error:
            if isinstance(error, BrokenPipeError) and _is_output_closed():
                raise typer.Exit(CLOSED_PIPE_EXIT_CODE) from None
            typer.echo(f"{type(error).__name__}: {_describe(error)}", err=True)
            raise typer.Exit(1) from None
        except KeyboardInterrupt:
            typer.echo("Stopped. Run the same command again to resume.", err=True)
            raise typer.Exit(130) from None


class _Command(TyperCommand):
    """Lists options that are for one case only, such as `with --task: ...`, in a section of it."""

    def get_help_option(self, ctx: Any) -> Any:
        return _false_unless_given(super().get_help_option(ctx))

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Lists the arguments, the options of every case, and those of each."""
        rows: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is None:
                continue
            name, text = record
            title = "Arguments"
            if parameter.param_type_name == "option":
                case = _CASE.match(text)
                title = case[1].capitalize() if case else "Options"
                text = text[case.end() :] if case else text
            rows.setdefault(title, []).append((name, text))
        for title, lines in rows.items():
            if lines:
                with formatter.section(title):
                    formatter.write_dl(lines)


class _App(typer.Typer):
    """Commands whose options are listed by case."""

    def command(self, name: str | None = None, **settings: Any) -> Any:
        return super().command(name, **{"cls": _Command, **settings})


_CASE = re.compile(r"(with --[a-z]+): ")
"""How the help of an option begins that has an effect in one case only."""

app = _App(
    cls=_Group,
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    help="Offline multi-agent RL datasets for multi-robot tasks.",
)
CLOSED_PIPE_EXIT_CODE = 128 + 13
"""Exit code of programs that SIGPIPE ends: nothing reads the output any more."""


class _Messages(logging.Handler):
    """Shows what the library logs on standard error, each line once in a command."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self._shown: set[str] = set()

    def emit(self, record: logging.LogRecord) -> None:
        text = printable(record.getMessage())
        if text not in self._shown:
            self._shown.add(text)
            typer.echo(text, err=True)


@contextmanager
def _shown_messages() -> Iterator[None]:
    log, handler = logging.getLogger("swarmdata"), _Messages()
    level = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.removeHandler(handler)
        log.setLevel(level)


def main() -> None:
    """Runs the command line."""
    warnings.formatwarning = _format_warning
    try:
        try:
            app()
        except SystemExit:
            if _is_output_closed():
                raise SystemExit(CLOSED_PIPE_EXIT_CODE) from None
            if sys.stdout is not None:
                sys.stdout.flush()  # at exit, Python would not say what failed
            raise
    except OSError as error:
        _discard_output()
        typer.echo(f"cannot write the output: {_describe(error)}", err=True)
        raise SystemExit(1) from None


def _format_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> str:
    """A warning without the line of code that raised it, which says nothing to users."""
    return f"{category.__name__}: {printable(str(message))}\n"


def _is_output_closed() -> bool:
    """Whether standard output is a pipe without a reader; if so, further output is discarded."""
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
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, sys.__stdout__.fileno())
        os.close(null)


def _reword(error: typer.BadParameter) -> None:
    """Typer checks values with pydantic, and shows its sentences; ours say got and expected."""
    from pydantic import ValidationError

    from swarmdata.specs.frozen import explain_value

    if isinstance(error.__cause__, ValidationError):
        error.message = explain_value(error.__cause__)


def _describe(error: OSError) -> str:
    """The system's message and the file; very long names are shortened."""
    if error.strerror is None:
        return printable(str(error))
    name = "" if error.filename is None else f": {str(error.filename)!r}"
    cut = f"{name[:120]}… ({len(str(error.filename))} characters)" if len(name) > 300 else name
    return printable(f"{error.strerror}{cut}")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"swarmdata {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_show_version, is_eager=True, help="Show the version and exit."
        ),
    ] = False,
) -> None:
    pass


def list_command() -> None:
    """List the published datasets, then others in the cache."""
    from swarmdata.hub.catalog.listing import list_datasets, own_datasets

    own, problems = own_datasets()
    every = [*list_datasets(), *own]
    line = f"{{:{max(len(info.id) for info in every)}}} {{:>7}} {{:>12}} {{:>10}} {{:>8}} {{:>8}}"
    typer.echo(line.format("id", "robots", "joint steps", "size", "score", "cached"))
    for info in every:
        size = f"{info.n_bytes / 1e6:.0f} MB" if info.n_bytes else "unknown"
        cached = "yes" if info.is_cached else "no"
        score = "unknown" if info.score is None else f"{info.score:.1f}"
        typer.echo(line.format(info.id, info.n_agents, f"{info.n_steps:,}", size, score, cached))
    for problem in problems:
        typer.echo(f"left out {problem}", err=True)


def info(dataset: IdOrPath) -> None:
    """Show a dataset's folder, digest and recipe.

    Takes the ids of published datasets, those in the cache, and folders.
    """
    from swarmdata.hub.catalog.listing import dataset_folder, list_datasets
    from swarmdata.registry.recipes import find_recipe, is_dataset
    from swarmdata.runtime.outside_names import is_folder

    if is_folder(dataset) or not is_dataset(dataset):
        from swarmdata.hub.catalog.catalog import find_folder
        from swarmdata.hub.catalog.identity import judge, misnamed
        from swarmdata.store import open_store

        stored = open_store(find_folder(dataset), "none")
        typer.echo(f"folder: {stored.path}\ndigest: {stored.manifest.digest}")
        if (sentence := misnamed(stored.path, stored.manifest)) is not None:
            typer.echo(f"{sentence}.", err=True)
        typer.echo(f"{judge(stored.manifest).sentence}\n{stored.recipe.to_yaml()}", nl=False)
        return
    recipe = find_recipe(dataset)
    entry = next(entry for entry in list_datasets() if entry.id == recipe.id)
    typer.echo(
        f"folder: {dataset_folder(recipe.id)}{'' if entry.is_cached else ' (not in the cache)'}"
    )
    typer.echo(f"published digest: {entry.digest or 'none'}")
    typer.echo(recipe.to_yaml(), nl=False)


def card(
    context: typer.Context,
    dataset: IdOrPath,
    write: Annotated[
        bool, typer.Option(help="also replace the card in the dataset's folder")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="folder for the card ID.md and its picture ID.png")
    ] = None,
    pictures: Annotated[bool, typer.Option(help="with --out: also draw the picture")] = True,
) -> None:
    """Print a dataset's card, or write it with its picture."""
    if out is None:
        refuse(context, ("pictures",), "without --out")
    from swarmdata.cards.card import card_of, write_card
    from swarmdata.cards.publish import CARDS, publish_card
    from swarmdata.hub.catalog.catalog import find_folder
    from swarmdata.runtime.output_folder import check_output

    if out is not None:
        check_output(out, CARDS)
    folder = find_folder(dataset)
    if out is None:
        typer.echo(card_of(folder), nl=False)
    else:
        for path in publish_card(folder, out, pictures=pictures):
            typer.echo(path)
    if write:
        write_card(folder)


def render(
    target: Annotated[
        str, typer.Argument(metavar="TARGET", help="policy, tier, run folder or dataset")
    ],
    out: Clip,
    episode: Annotated[
        int, typer.Option(min=0, help="index of the evaluation seed or recorded episode")
    ] = 0,
    task: Task = None,
    observation: Observation = None,
    communication: Communication = None,
) -> None:
    """Draw one episode of a policy or of a dataset."""
    from swarmdata.evaluation.results.clips import draw_target

    draw_target(target, out, episode, task, observation, communication)
    typer.echo(out)


def references(
    tasks: Annotated[
        list[str], typer.Argument(metavar="TASK...", help="presets such as coop_nav, or spec files")
    ],
    episodes: Episodes = 1000,
    out: Annotated[
        Path | None, typer.Option(help="JSON file to update; default: print the table")
    ] = None,
    backend: Backend = None,
) -> None:
    """Measure the reference policies of tasks.

    Their results are the scale of the score; the package has them in cards/references.json. In
    tasks of several sides, each side plays against the scripted others.
    """
    from swarmdata.evaluation.results.target_evaluation import reference_tables
    from swarmdata.hub.publishing.regenerate import put_entries
    from swarmdata.runtime.batches import Failures

    failures = Failures(len(tasks))
    for task in tasks:
        with failures.item(task):
            found = reference_tables(task, episodes, backend)
            entries = {name: asdict(table) for name, table in found.items()}
            if out is None:
                typer.echo(json.dumps(entries, indent=1, sort_keys=True, allow_nan=False))
            else:
                put_entries(out, entries)
    failures.check("tasks")


MAINTENANCE = "Maintenance"
"""Section of the commands that only maintainers of this repository need; the help leaves it out."""

SECTIONS: dict[str, dict[str, Any]] = {
    "First": {
        "list": list_command,
        "info": info,
        "train": training_commands.train,
        "train-online": training_commands.train_online,
        "evaluate": result_commands.evaluate,
        "report": result_commands.report,
        "render": render,
        "generate": generate_commands.generate,
    },
    "Data": {
        "record": import_commands.record_app,
        "import": import_commands.import_command,
        "fetch": import_commands.fetch,
        "fit": import_commands.fit,
        "convert": convert_commands.convert,
        "filter": editing_commands.filter_command,
        "combine": editing_commands.combine_command,
        "subsample": editing_commands.subsample_command,
        "audit": integrity_commands.audit,
        "verify": integrity_commands.verify,
        "card": card,
    },
    "Tasks": {"task": task_app},
    "Learning": {
        "algorithms": training_commands.algorithms,
        "tune": training_commands.tune,
        "study": study_commands.study,
        "sweep": sweep_commands.sweep,
        "rank": result_commands.rank,
        "export-policy": training_commands.export_policy,
    },
    "Hub": {
        "pull": remote_commands.pull,
        "push": remote_commands.push,
        "remote": remote_commands.remote_app,
        "catalogue": catalogue_app,
        "leaderboard": leaderboard_app,
        "warm": registry_commands.warm,
    },
    MAINTENANCE: {
        "references": references,
        "study-cards": study_commands.study_cards,
        "registry": registry_commands.registry_app,
        "ship": training_commands.ship,
    },
}
"""Commands in the order of `swarmdata --help`, the common path first."""

for _commands in SECTIONS.values():
    for _name, _command in _commands.items():
        if isinstance(_command, typer.Typer):
            app.add_typer(_command, name=_name)
        else:
            app.command(_name)(_command)
