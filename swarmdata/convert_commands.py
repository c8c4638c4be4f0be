"""`swarmdata convert`: datasets out to the formats of others, and theirs in."""

from pathlib import Path
from typing import Annotated, Literal

import typer


def convert(
    source: Annotated[
        str, typer.Argument(metavar="SRC", help="with --to: an id or folder; with --from: theirs")
    ],
    target: Annotated[Path, typer.Argument(metavar="DST", help="file or folder to make")],
    to: Annotated[
        str | None, typer.Option("--to", metavar="FORMAT", help="d4rl, minari, parquet, ...")
    ] = None,
    from_: Annotated[
        str | None, typer.Option("--from", metavar="FORMAT", help="the same, and numpy")
    ] = None,
    split: Annotated[
        str | None, typer.Option(help="with --to: only train, validation or test")
    ] = None,
    policy: Annotated[str | None, typer.Option(help="with --to: only this policy's")] = None,
    id_: Annotated[
        str | None,
        typer.Option("--id", metavar="ID", help="with --from: such as spread-omar_medium-v0"),
    ] = None,
    time_limit: Annotated[
        int | None, typer.Option(help="steps after which episodes are cut; 0: there is no limit")
    ] = None,
    episode_length: Annotated[
        int | None, typer.Option(help="of all episodes, where there are no flags")
    ] = None,
    final: Annotated[
        str | None, typer.Option(help="missing last observations: repeat, or cut")
    ] = None,
    unfinished: Annotated[
        str | None, typer.Option(help="rows behind the last end: truncate, or drop")
    ] = None,
    agents: Annotated[
        str | None, typer.Option(help="number of agents, or their names with commas")
    ] = None,
    action_bounds: Annotated[
        str | None, typer.Option(metavar="LOW,HIGH", help="of continuous actions")
    ] = None,
    new_splits: Annotated[bool, typer.Option(help="draw splits instead of those kept")] = False,
    note: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=TEXT", help="to remember, such as license=mit; may be repeated"),
    ] = None,
) -> None:
    """Convert a dataset to another format (--to), or data of another format to a dataset (--from).

    What a file does not say, such as where a time limit cut an episode, is asked for, not guessed.
    """
    if (to is None) == (from_ is None):
        raise typer.BadParameter("pass either --to FORMAT or --from FORMAT")
    if to is not None:
        typer.echo(_export(source, target, to, split, policy))
        return
    if id_ is None:
        raise typer.BadParameter("needed with --from", param_hint="--id")
    from swarmdata.interop.choices import Choices
    from swarmdata.interop.importing import import_dataset

    low, high = _bounds(action_bounds)
    choices = Choices.of(
        time_limit=time_limit,
        episode_length=episode_length,
        final=final,
        unfinished=unfinished,
        agents=agents,
        action_low=low,
        action_high=high,
    )
    splits: Literal["kept", "new"] = "new" if new_splits else "kept"
    made = import_dataset(
        source, target, format=str(from_), id=id_, choices=choices, splits=splits,
        metadata=_notes(note or []),
    )  # fmt: skip
    typer.echo(f"{made.path}\n{made.n_steps:,} joint steps, digest {made.digest}")


def _export(source: str, target: Path, to: str, split: str | None, policy: str | None) -> Path:
    from swarmdata.catalog import load
    from swarmdata.dataset import Dataset
    from swarmdata.interop.exporting import export_dataset

    dataset = Dataset.open(source) if Path(source).is_dir() else load(source)
    return export_dataset(dataset.filter(split=split, policy=policy), target, format=to)


def _bounds(text: str | None) -> tuple[float | None, float | None]:
    if text is None:
        return None, None
    try:
        low, high = map(float, text.split(","))
    except ValueError as error:
        raise typer.BadParameter(
            f"got {text!r}, expected two numbers such as -1,1", param_hint="--action-bounds"
        ) from error
    return low, high


def _notes(pairs: list[str]) -> dict[str, str]:
    wrong = [pair for pair in pairs if "=" not in pair]
    if wrong:
        raise typer.BadParameter(f"got {wrong[0]!r}, expected KEY=TEXT", param_hint="--note")
    return dict(pair.split("=", 1) for pair in pairs)
