"""`swarmdata task ...`: the worlds there are, what they consist of, and how they look in motion."""

from pathlib import Path
from typing import Annotated

import typer

Observation = Annotated[
    str | None,
    typer.Option(
        help="what robots sense: a name such as lidar or lidar-32+noise-0.05, or a YAML file",
        show_default="as in the task, the dataset or the training",
    ),
]
Communication = Annotated[
    str | None,
    typer.Option(
        help="what robots hear: a name such as none, perfect or lossy-30, or a YAML file",
        show_default="as in the task, the dataset or the training",
    ),
]
NameOrFile = Annotated[
    str, typer.Argument(metavar="NAME_OR_FILE", help="a preset, or a spec's YAML or JSON file")
]

task_app = typer.Typer(
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Show, check and play the worlds: presets of the package, or specs in files.",
)


@task_app.command("list")
def list_command() -> None:
    """Show every preset."""
    from swarmdata.registry.presets import preset, preset_names, preset_summary

    line = "{:22} {:11} {:>6}  {:>11}  {:>7}  {}"
    typer.echo(line.format("name", "task", "robots", "arena (m)", "horizon", "what"))
    for name in preset_names():
        spec = preset(name)
        arena = f"{spec.arena.width:g} x {spec.arena.height:g}"
        row = (name, spec.task, spec.n_agents, arena, spec.horizon, preset_summary(name))
        typer.echo(line.format(*row))


@task_app.command()
def show(name: NameOrFile) -> None:
    """Print a whole spec as YAML, every default written out."""
    from swarmdata.registry.presets import find_spec

    typer.echo(find_spec(name).to_yaml(), nl=False)


@task_app.command()
def validate(name: NameOrFile) -> None:
    """Check a spec: read it, build its world, begin episodes, and drive for some steps.

    All wrong keys and values are named at once, with their paths and what is allowed; then
    what is wrong between them; then what is wrong with the world.
    """
    from swarmdata.registry.presets import find_spec
    from swarmdata.rollouts.spec_check import probe
    from swarmdata.specs.budget import demand_of, describe_demand, size_of
    from swarmdata.specs.model_choice import describe

    spec = find_spec(name)
    env = probe(spec)
    demand = demand_of(spec, size_of(spec), spec.n_substeps)
    typer.echo(
        f"OK: {spec.task} with {spec.n_agents} robots, {describe(spec)}; per robot "
        f"{env.observation_size} numbers observed and {env.action_size} commanded; spec "
        f"{spec.hash()[:12]}; {describe_demand(demand)}"
    )


@task_app.command()
def table(
    out: Annotated[Path, typer.Option(help="the .md file")],
) -> None:
    """Write the page of what policies without training achieve in every preset (docs/worlds.md)."""
    from swarmdata.cards.worlds_page import worlds_page
    from swarmdata.registry.published import references
    from swarmdata.store import write_file

    write_file(out, worlds_page(references()).encode())
    typer.echo(out)


@task_app.command()
def play(
    name: NameOrFile,
    out: Annotated[Path, typer.Option(help="the .gif, .mp4 or .png file")],
    policy: Annotated[str, typer.Option(help="a policy, tier or run folder")] = "scripted",
    episode: Annotated[int, typer.Option(min=0, help="number of the evaluation seed")] = 0,
    observation: Observation = None,
    communication: Communication = None,
    size: Annotated[int, typer.Option(min=64, help="pixels of the arena's longer side")] = 384,
    stride: Annotated[int, typer.Option(min=1, help="control steps between two pictures")] = 2,
) -> None:
    """Run a policy for one episode and draw it, with lidar rays and messages if there are any."""
    from swarmdata.evaluation.results.report import draw_target
    from swarmdata.types import END_REASONS

    played = draw_target(
        policy, out, episode, name, observation, communication, size=size, stride=stride
    )
    typer.echo(
        f"{out}: {len(played)} steps, ended by {END_REASONS[played.end_reason]}, return "
        f"{played.team_return:.2f}"
    )


def setting(text: str) -> tuple[str, str]:
    """Splits the text of one `--set`."""
    key, equals, value = text.partition("=")
    if not equals:
        raise typer.BadParameter(f"{text!r} is not KEY=VALUE", param_hint="--set")
    return key, value
