"""The named specs of the package: one YAML file each in `envs/presets`."""

from functools import cache
from importlib.resources import files
from itertools import takewhile
from pathlib import Path

from swarmdata.errors import INSTALL_HINT, SpecError, UnknownNameError, check_type
from swarmdata.runtime.documents import read_document
from swarmdata.specs.task_spec import TaskSpec

_FOLDER = files("swarmdata") / "envs" / "presets"  # read, and nothing of `envs` is imported

SPEC_SUFFIXES = (".yaml", ".yml", ".json")  # endings of a spec's file


@cache
def preset_names() -> tuple[str, ...]:
    """Names of all presets, sorted."""
    return tuple(sorted(Path(f.name).stem for f in _FOLDER.iterdir() if f.name.endswith(".yaml")))


@cache
def preset(name: str) -> TaskSpec:
    """The spec of a preset, such as `coop_nav` or `formation-n8`.

    Raises:
        UnknownNameError: with the nearest known name.
    """
    return TaskSpec.from_text(_read(name), f"preset {name}")


@cache
def preset_summary(name: str) -> str:
    """The first sentence of a preset's file, in the comment above the spec; empty if none."""
    comment = takewhile(lambda line: line.startswith("#"), _read(name).splitlines())
    sentence, stop, _ = " ".join(line.lstrip("# ").rstrip() for line in comment).partition(". ")
    return sentence + stop.rstrip()


def name_of(spec: TaskSpec) -> str:
    """The name of the preset that a spec is, or else of its task."""
    return next((name for name in preset_names() if preset(name) == spec), spec.task)


def _read(name: str) -> str:
    if name not in preset_names():
        raise UnknownNameError("task", name, preset_names(), INSTALL_HINT)
    return (_FOLDER / f"{name}.yaml").read_text(encoding="utf-8")


def find_spec(task: str | Path | TaskSpec) -> TaskSpec:
    """A preset by name, the spec in a `.yaml` or `.json` file, or a spec itself.

    A file may have `map: FILE`, a map of walls for `coop_nav` (`specs.map_file`).

    Raises:
        UnknownNameError: no such preset.
        SpecError: the file cannot be read, or is not a spec.
        SchemaError: it is an object of another type, such as a dataset.
    """
    if isinstance(task, TaskSpec):
        return task
    advice = (
        "Pass dataset.task of a dataset of such a task; a recorded environment is played by "
        "swarmdata.evaluate_parallel."
    )
    expected = "a preset's name, a spec file or the TaskSpec of a task that can be simulated"
    check_type("the task", task, (str, Path), expected, advice)
    path = Path(task)
    if path.suffix not in SPEC_SUFFIXES:
        return preset(str(task))
    try:
        document = read_document(path)
        if isinstance(document, dict) and "map" in document:
            from swarmdata.specs.map_file import with_map  # noqa: PLC0415  (only for maps)

            document = with_map(document, path.parent)
        return TaskSpec.parse(document, str(path))
    except (OSError, UnicodeDecodeError) as error:
        raise SpecError(
            f"cannot read a spec from {path}: {error}. Give a YAML or JSON file, or one of the "
            f"presets {', '.join(preset_names())}."
        ) from error
