"""Reads map files, and the origins of imported datasets in their place."""

from collections.abc import Mapping
from pathlib import Path

from swarmdata.errors import SpecError
from swarmdata.runtime.documents import read_document
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import ImportedLogs


def shipped_maps() -> dict[str, Path]:
    """The maps of public logs that the package has, by name."""
    folder = Path(__file__).parent / "maps"
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def read_map(source: Path | str) -> LogMap | ImportedLogs:
    """Reads a map by its path or its name in `shipped_maps`, or the `recipe.json` of an import."""
    path = Path(source)
    if not path.exists():
        path = shipped_maps().get(str(source), path)
    content = read_document(path.expanduser())
    if isinstance(content, Mapping) and "kind" in content:
        if content["kind"] != "logs":
            raise SpecError(
                f"{path} is of a dataset that was not made of logs (kind {content['kind']!r}), "
                "expected a map, or the recipe.json of an imported dataset"
            )
        return ImportedLogs.parse(content, str(path))
    return LogMap.parse(content, str(path))
