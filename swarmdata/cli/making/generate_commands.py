"""`swarmdata generate`: builds a dataset from its recipe, or from a task and policies."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmdata.cli.option_use import refuse, refuse_all_but, refuse_workers
from swarmdata.cli.shared_options import (
    Backend,
    Communication,
    Engine,
    Notes,
    Observation,
    Part,
    Randomize,
    Workers,
    parse_part,
    parse_ranges,
    parse_settings,
)

if TYPE_CHECKING:
    from swarmdata.specs.recipe import Recipe

RECIPE_OPTIONS = ("steps", "workers", "engine", "part", "finish", "remote", "out")
"""Options of `generate` that a recipe has not decided; a task with policies has them all."""


def generate(
    context: typer.Context,
    dataset: Annotated[
        str | None, typer.Argument(metavar="[ID_OR_RECIPE]", help="dataset id or recipe file")
    ] = None,
    task: Annotated[
        str | None, typer.Option(help="make a dataset of this task: a preset, or a spec file")
    ] = None,
    policy: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME[=SHARE]",
            help="with --task: run folder, policy or tier, or a policy for each side, as in "
            "scripted,random; may be repeated. Shares of the joint steps "
            "are equal unless given, as in scripted=0.3",
        ),
    ] = None,
    new_id: Annotated[
        str | None, typer.Option("--id", metavar="ID", help="with --task: such as my_task-mine-v0")
    ] = None,
    steps: Annotated[
        int | None,
        typer.Option(
            min=1, help="number of joint steps; default: as in the recipe, with --task 50,000"
        ),
    ] = None,
    noise: Annotated[
        float, typer.Option(min=0, help="with --task: deviation of the noise on actions")
    ] = 0.0,
    observation: Observation = None,
    communication: Communication = None,
    backend: Backend = None,
    randomize: Randomize = None,
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="with --task: seed of the episodes; default: made of the id"),
    ] = None,
    tier: Annotated[str, typer.Option(help="with --task: tier of the new dataset")] = "own",
    note: Notes = None,
    workers: Workers = None,
    engine: Engine = "local",
    part: Part = None,
    finish: Annotated[
        bool,
        typer.Option("--finish", help="assemble the parts that --part has made, and make none"),
    ] = False,
    remote: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="folder or bucket through which parts travel, for machines without a shared "
            "folder",
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="folder of the dataset; default: in the cache")
    ] = None,
) -> None:
    """Build a dataset of a recipe, or of a task and policies.

    With --task, networks of training runs are copied into the dataset, and its recipe.json makes it
    again. An interrupted build resumes: run the same command again.
    """
    if (dataset is None) == (task is None):
        raise typer.BadParameter(
            "generate needs a dataset's ID or a recipe file, or --task TASK, and not both"
        )
    refuse_workers(context, engine)
    if dataset is not None:
        refuse_all_but(context, RECIPE_OPTIONS, f"with {dataset}, whose recipe decides it")
        if part is not None:
            refuse(context, ("workers", "engine", "finish"), "with --part")
        elif finish:
            refuse(context, ("workers", "engine"), "with --finish")
        _follow_recipe(dataset, steps, out, workers, engine, part, remote, finish=finish)
        return
    refuse(context, ("part", "finish", "remote"), "with --task; they take a recipe's file")
    if not policy or new_id is None:
        raise typer.BadParameter("--task needs --policy NAME and --id ID")
    from swarmdata.evaluation.runs import generated_dataset

    n_steps = steps or generated_dataset.DEFAULT_STEPS
    made = generated_dataset.generate(
        task or "", read_shares(policy), id=new_id, n_steps=n_steps, noise=noise, tier=tier,
        observation=observation, communication=communication, backend=backend,
        randomization=parse_ranges(randomize), seed=seed,
        metadata=parse_settings(note, "--note"), out=out, workers=workers, engine=engine,
        report=typer.echo,
    )  # fmt: skip
    _print_built(made.path)


def read_shares(texts: list[str]) -> dict[str, float]:
    """Reads `NAME` or `NAME=SHARE` of each text; a share that is not given is 1."""
    shares: dict[str, float] = {}
    for text in texts:
        name, equals, share = text.rpartition("=")
        if not equals:
            name, share = text, "1"
        try:
            value = float(share)
        except ValueError as error:
            raise typer.BadParameter(
                f"{text!r} has the share {share!r}, expected a number", param_hint="--policy"
            ) from error
        if name in shares:
            raise typer.BadParameter(f"{name} is given twice", param_hint="--policy")
        shares[name] = value
    return shares


def _follow_recipe(
    dataset: str, steps: int | None, out: Path | None, workers: int | None, engine: str,
    part: str | None, remote: str | None, *, finish: bool,
) -> None:  # fmt: skip
    """Makes a share of the parts, assembles them, or does both."""
    recipe, folder, beside = _what_to_build(dataset, steps, out)
    from swarmdata.building import shares
    from swarmdata.building.build import build
    from swarmdata.hub.remotes.addresses import open_remote

    through = None if remote is None else open_remote(remote)
    if part is not None:
        made = shares.make_share(
            recipe, folder, *parse_part(part), checkpoints=beside, remote=through
        )
        typer.echo(f"{recipe.id}: made {len(made)} parts of share {part}")
        return
    if through is not None:
        n = shares.receive_parts(recipe, folder, through, checkpoints=beside)
        typer.echo(f"{recipe.id}: fetched {n} parts from {remote}")
    if finish:
        _print_built(shares.finish_parts(recipe, folder))
    else:
        _print_built(build(recipe, folder, checkpoints=beside, workers=workers, engine=engine))


def _what_to_build(
    dataset: str, steps: int | None, out: Path | None
) -> "tuple[Recipe, Path, Path | None]":
    """The recipe, the dataset's folder, and a folder with the recipe's networks."""
    from swarmdata.hub.catalog.listing import dataset_folder
    from swarmdata.registry.recipes import find_recipe
    from swarmdata.specs.recipe import Recipe

    path = Path(dataset)
    is_file = path.suffix in (".json", ".yaml", ".yml")
    if is_file and not path.exists():
        raise typer.BadParameter(f"there is no file {dataset}")
    recipe = _recipe_of(path) if is_file else find_recipe(dataset)
    if out is None and (is_file or steps is not None):
        raise typer.BadParameter("required for a recipe file and with --steps", param_hint="--out")
    if steps is not None:
        recipe = Recipe.parse({**recipe.model_dump(), "n_steps": steps})
    return recipe, out or dataset_folder(recipe.id), path.parent if is_file else None


def _recipe_of(path: Path) -> "Recipe":
    from swarmdata.errors import SpecError
    from swarmdata.runtime.documents import read_document
    from swarmdata.specs.recipe import Recipe

    content = read_document(path)
    if isinstance(content, dict) and "kind" in content:
        raise SpecError(
            f"{path} is of a dataset of the kind {content['kind']!r:.100}, which is not simulated; "
            "expected a recipe. `swarmdata verify FOLDER --repair` makes edits again"
        )
    return Recipe.parse(content, str(path))


def _print_built(folder: Path) -> None:
    from swarmdata.store import read_manifest

    manifest = read_manifest(folder)
    typer.echo(f"{folder}\n{manifest.n_steps:,} joint steps, digest {manifest.digest}")
