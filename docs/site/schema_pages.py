"""Pages of the files that users write: tasks, recipes and studies, field by field."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from docs.site.docstrings import field_notes, markdown_of
from swarmdata.drawing.markdown import table
from swarmdata.evaluation.study.plan import Study
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.recipe import Recipe
from swarmdata.specs.task_spec import TaskSpec

SCHEMAS: Mapping[str, tuple[str, type[Frozen], str]] = {
    "task": (
        "Task files", TaskSpec,
        "A task is a YAML or JSON file with the fields of `TaskSpec`. Whatever a file leaves out "
        "has its default; unknown keys are refused. `swarmdata task show PRESET` writes a full "
        "one, `swarmdata task validate FILE` checks one. [Tasks](../../docs/tasks.md) is the guide."
    ),
    "recipe": (
        "Recipe files", Recipe,
        "A recipe is a YAML or JSON file that `swarmdata generate` makes a dataset of, and the "
        "`recipe.json` of every generated dataset. [Generating and editing]"
        "(../../docs/generating.md) is the guide, and [task files](task.md) describe `spec`."
    ),
    "study": (
        "Study files", Study,
        "A study is a YAML file that `swarmdata study` runs. "
        "[Studies](../../docs/studies.md) is the guide."
    ),
    "logs": (
        "Maps of logs", LogMap,
        "A map is a YAML file that says `swarmdata import` which columns and topics of logs are "
        "poses, commands and observations. `each` holds for every robot, and `{robot}` is its "
        "name. [Your data](../../docs/your-data.md) is the guide."
    ),
}  # fmt: skip
"""Title, model and introduction of each kind of file."""

NO_LIMIT = 10**12  # upper bound of quantities that have none in practice; pages leave it out

HEAD = ("field", "type and range", "default", "meaning")


def schema_pages() -> dict[str, str]:
    """A page for each kind of file, and their index."""
    pages = {f"reference/schemas/{name}.md": schema_page(name) for name in SCHEMAS}
    rows = [
        [f"[{title}]({name}.md)", model.__doc__.splitlines()[0] if model.__doc__ else ""]
        for name, (title, model, _) in SCHEMAS.items()
    ]
    pages["reference/schemas/index.md"] = (
        "# Schemas of files\n\nEvery field of the files that users write, from the models that "
        f"check them.\n\n{table(('file', 'what it describes'), rows)}"
    )
    return pages


def schema_page(name: str) -> str:
    """The page of one kind of file: a section for its model and for each model within."""
    title, model, introduction = SCHEMAS[name]
    for each in models().values():
        each.model_rebuild()  # older pydantic cannot show defaults of models that are not built
    schema = model.model_json_schema()
    inner: dict[str, Any] = schema.get("$defs", {})
    if name == "recipe":  # the page of tasks has the rest
        inner = {key: inner[key] for key in ("PolicySource", "Splits")}
    text = f"# {title}\n\n{introduction}\n"
    for key, content in [(model.__name__, schema), *sorted(inner.items())]:
        text += _section(key, content, set(inner))
    return text


def _section(name: str, content: Mapping[str, Any], known: set[str]) -> str:
    model = models()[name]
    notes, required = field_notes(model), content.get("required", ())
    rows = [
        [
            f"`{field}`",
            words_of(described, known),
            "**required**" if field in required else _default(described),
            notes.get(field) or ("selects this model" if "const" in described else ""),
        ]
        for field, described in content.get("properties", {}).items()
    ]
    return f"\n## {name}\n\n{markdown_of(model.__doc__ or '')}\n{table(HEAD, rows)}"


def models() -> dict[str, type[Frozen]]:
    """Every frozen model of the package by its name."""

    def descendants(model: type[Frozen]) -> Iterator[type[Frozen]]:
        for child in model.__subclasses__():
            yield child
            yield from descendants(child)

    return {m.__name__: m for m in descendants(Frozen) if m.__module__.startswith("swarmdata.")}


def words_of(schema: Mapping[str, Any], known: set[str]) -> str:
    """A JSON schema of one value in words; models that are `known` have a section to link to."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})" if name in known else name
    for key in ("anyOf", "oneOf"):
        if key in schema:
            return " or ".join(dict.fromkeys(words_of(each, known) for each in schema[key]))
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join(f"`{each}`" for each in schema["enum"])
    return _of_type(schema, known)


def _of_type(schema: Mapping[str, Any], known: set[str]) -> str:
    kind = schema.get("type")
    if kind == "array" and "prefixItems" in schema:
        return "list of " + ", ".join(words_of(each, known) for each in schema["prefixItems"])
    if kind == "array":
        least, most = schema.get("minItems"), schema.get("maxItems")
        return f"list of {words_of(schema['items'], known)}{_range(least, most, ' of them')}"
    if kind == "object":
        values = schema.get("additionalProperties")
        kind_of_values = words_of(values, known) if isinstance(values, Mapping) else "any value"
        return f"mapping of names to {kind_of_values}"
    names = {"string": "text", "boolean": "true or false", "null": "none"}
    words = "any value" if kind is None else names.get(kind, str(kind))
    above, below = schema.get("exclusiveMinimum"), schema.get("exclusiveMaximum")
    bounds = "" if above is None else f", above {above:g}"
    bounds += "" if below is None else f", below {below:,}"
    most = schema.get("maximum")
    limits = _range(schema.get("minimum"), None if most == NO_LIMIT else most, "")
    form = f", of the form `{schema['pattern']}`" if "pattern" in schema else ""
    return words + bounds + limits + form


def _range(least: float | None, most: float | None, of: str) -> str:
    shown = [None if each is None else f"{each:,}".removesuffix(".0") for each in (least, most)]
    if shown[0] is None:
        return "" if shown[1] is None else f", at most {shown[1]}{of}"
    return f", at least {shown[0]}{of}" if shown[1] is None else f", {shown[0]} to {shown[1]}{of}"


def _default(schema: Mapping[str, Any]) -> str:
    value = schema.get("default")
    if isinstance(value, Mapping):
        return f"`kind: {value['kind']}`" if "kind" in value else "defaults of the model"
    if isinstance(value, list) and value and isinstance(value[0], Mapping):
        return "one with defaults"
    if value is None:
        return "none"
    return f"`{json.dumps(value) if not isinstance(value, str) else value or chr(39) * 2}`"
