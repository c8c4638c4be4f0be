"""Refuses options that a command would not use: whoever gives one expects an effect."""

from collections.abc import Collection

import typer


def given(context: typer.Context, name: str) -> bool:
    """Whether an option or argument was given, rather than its default taken."""
    source = context.get_parameter_source(name)
    return source is not None and source.name not in ("DEFAULT", "DEFAULT_MAP")


def refuse(context: typer.Context, names: Collection[str], where: str) -> None:
    """Refuses options, by their Python names, that have no effect `where`: "with --part"."""
    for parameter in context.command.params:
        if parameter.name in names and given(context, parameter.name):
            raise typer.BadParameter(
                f"it has no effect {where}; leave it out",
                param_hint=parameter.opts[0] if parameter.opts else parameter.name,
            )


def refuse_all_but(context: typer.Context, names: Collection[str], where: str) -> None:
    """Refuses every option but some, as `refuse` does; arguments are not looked at."""
    options = [each for each in context.command.params if each.param_type_name == "option"]
    refuse(context, {each.name or "" for each in options} - {*names}, where)


def refuse_workers(context: typer.Context, engine: str) -> None:
    """Refuses `--workers` beside an engine that has workers of its own."""
    if engine != "local":
        refuse(context, ("workers",), f"with --engine {engine}, which has workers of its own")
