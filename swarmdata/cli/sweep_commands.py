"""`swarmdata sweep`: policies under worse conditions, or in another simulator."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from swarmdata.cli.option_use import refuse, refuse_all_but, refuse_workers
from swarmdata.cli.shared_options import (
    Backend,
    Engine,
    Episodes,
    Processes,
    Randomize,
    Task,
    Validation,
    parse_ranges,
)

if TYPE_CHECKING:
    from swarmdata.evaluation.robustness.sweep import Sweep
    from swarmdata.evaluation.robustness.sweep_axes import Part
    from swarmdata.numerics.random import SeedBlock

_AXIS = "NAME=A..B|A,B,..."


def sweep(
    context: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="RUN...", help="run folders, tiers, or datasets of trained policies"
        ),
    ],
    out: Annotated[Path, typer.Option(help="folder for results, tables and figures")],
    communication: Annotated[
        list[str] | None,
        typer.Option(metavar=_AXIS, help="such as drop=0..0.8 or bandwidth=3,2,1; may be repeated"),
    ] = None,
    observation: Annotated[
        list[str] | None,
        typer.Option(metavar=_AXIS, help="such as noise=0..0.2 or range=2..0.5; may be repeated"),
    ] = None,
    body: Annotated[
        list[str] | None,
        typer.Option(
            metavar=_AXIS, help="such as max_speed=0.6..0.3 or payload_mass=4,8; may be repeated"
        ),
    ] = None,
    simulator: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="compare with this simulator instead: mujoco, kinematic or pymunk"
        ),
    ] = None,
    values: Annotated[
        int, typer.Option(min=2, help="number of values from A to B, both included")
    ] = 5,
    episodes: Episodes = 200,
    validation: Validation = False,
    task: Task = None,
    backend: Backend = None,
    randomize: Randomize = None,
    workers: Processes = 1,
    engine: Engine = "local",
    points: Annotated[
        bool, typer.Option("--points", help="list the points, and which are done")
    ] = False,
    json: Annotated[
        bool, typer.Option("--json", help="with --points: a line of JSON for each")
    ] = False,
    point: Annotated[
        str | None, typer.Option(metavar="POINT", help="evaluate this point here; for schedulers")
    ] = None,
    collect: Annotated[
        bool, typer.Option("--collect", help="write what finished points give, and evaluate none")
    ] = False,
) -> None:
    """Evaluate policies with worse sensors, radios and robots.

    One parameter changes at a time; everything else is as in training, on the same seeds. With
    --simulator, policies act in another simulator, on the same seeds and layouts. An interrupted
    sweep resumes: run the same command again.
    """
    refuse_workers(context, engine)
    block: SeedBlock = "validation" if validation else "evaluation"
    if simulator is not None:
        refuse_all_but(context, COMPARED, "with --simulator")
        from swarmdata.evaluation.robustness import simulator_transfer

        simulator_transfer.compare_simulators(
            targets, out, backend=simulator, task=task, n_episodes=episodes, block=block,
            engine=engine, workers=workers,
        )  # fmt: skip
        typer.echo(out / simulator_transfer.TABLE_FILE)
        return
    asked: dict[Part, list[str] | None] = {
        "communication": communication,
        "observation": observation,
        "body": body,
    }
    named = [(text, part) for part, texts in asked.items() for text in texts or ()]
    if not any(".." in text for text, _ in named):
        refuse(context, ("values",), "without an axis such as noise=0..0.2")
    from swarmdata.evaluation.robustness import sweep as sweeps
    from swarmdata.evaluation.robustness.sweep_axes import parse_axis

    axes = [parse_axis(text, part, values) for text, part in named]
    planned = sweeps.plan_sweep(
        targets, axes, out, n_episodes=episodes, task=task, backend=backend,
        randomization=parse_ranges(randomize), block=block,
    )  # fmt: skip
    if points or point is not None or collect:
        _do_some(context, planned, points=points, as_json=json, point=point)
        return
    refuse(context, ("json",), "without --points")
    sweeps.run_sweep(planned, engine=engine, workers=workers)
    _print(planned)


COMPARED = ("out", "simulator", "task", "episodes", "validation", "engine", "workers")
"""Options of a comparison of two simulators."""


def _do_some(
    context: typer.Context, planned: "Sweep", *, points: bool, as_json: bool, point: str | None
) -> None:
    """Lists points, evaluates one of them here, or collects those that are done."""
    from swarmdata.evaluation.robustness.sweep import collect_sweep, run_point

    elsewhere = ("workers", "engine")
    if points:
        refuse(context, (*elsewhere, "point", "collect"), "with --points")
        _list_points(planned, as_json=as_json)
    elif point is not None:
        refuse(context, (*elsewhere, "json", "collect"), "with --point")
        is_new = run_point(planned, point)
        typer.echo(f"{point}: {'done' if is_new else 'was done before'}")
    else:
        refuse(context, (*elsewhere, "json"), "with --collect")
        collect_sweep(planned)
        _print(planned)


def _list_points(planned: "Sweep", *, as_json: bool) -> None:
    import json

    for name, evaluations in planned.points().items():
        done = all(each.result() is not None for each in evaluations)
        found = {"point": name, "done": done, "policies": len(evaluations)}
        typer.echo(json.dumps(found) if as_json else f"{'done' if done else 'open'}  {name}")


def _print(swept: "Sweep") -> None:
    typer.echo((swept.out / "sweep.md").read_text(encoding="utf-8"), nl=False)
    for axis in swept.axes:
        typer.echo(swept.out / f"{axis.part}-{axis.name}.png")
