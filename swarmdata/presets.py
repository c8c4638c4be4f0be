"""The named specs of the package: one YAML file each in `envs/presets`."""

from functools import cache
from importlib.resources import files
from pathlib import Path

from swarmdata.errors import UnknownNameError
from swarmdata.spec import TaskSpec

FOLDER = "presets"


@cache
def preset_names() -> tuple[str, ...]:
    """Names of all presets, sorted."""
    folder = files("swarmdata.envs") / FOLDER
    return tuple(sorted(Path(f.name).stem for f in folder.iterdir() if f.name.endswith(".yaml")))


@cache
def preset(name: str) -> TaskSpec:
    """The spec of a preset, such as `coop_nav` or `formation-n8`.

    Raises:
        UnknownNameError: with the nearest known name.
    """
    if name not in preset_names():
        raise UnknownNameError("task", name, preset_names())
    file = files("swarmdata.envs") / FOLDER / f"{name}.yaml"
    return TaskSpec.from_text(file.read_text(encoding="utf-8"), f"preset {name}")


def find_spec(name_or_path: str) -> TaskSpec:
    """A preset by name, or the spec in a `.yaml` or `.json` file.

    Raises:
        UnknownNameError: neither.
        SpecError: the file is not a spec.
    """
    path = Path(name_or_path)
    if path.suffix in (".yaml", ".yml", ".json") and path.exists():
        return TaskSpec.from_file(path)
    return preset(name_or_path)
