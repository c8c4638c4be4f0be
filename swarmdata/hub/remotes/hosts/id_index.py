"""The list of ids that a static host serves as `index.json`, since it cannot list folders."""

import json

from swarmdata.errors import HubError, SpecError
from swarmdata.runtime.documents import parse_json
from swarmdata.runtime.outside_names import is_id

INDEX_FILE = "index.json"  # its name, beside the folders of the datasets

MAX_INDEX_BYTES = 16 << 20  # most bytes of an index; 100,000 ids take 4 MB


def index_bytes(ids: tuple[str, ...]) -> bytes:
    """The file's content."""
    return (json.dumps({"format": 1, "ids": sorted(ids)}, indent=1) + "\n").encode()


def read_index(content: bytes, address: str) -> tuple[str, ...]:
    """Returns the ids, sorted."""
    try:
        data = parse_json(content, INDEX_FILE)
    except SpecError as error:
        raise _wrong(address, f"it is not JSON ({error})") from error
    listed = data.get("ids") if isinstance(data, dict) else None
    if not isinstance(listed, list) or not all(isinstance(each, str) for each in listed):
        raise _wrong(address, "it has no list of names under 'ids'")
    strange = [each[:100] for each in listed if not is_id(each)]
    if strange:
        raise _wrong(address, f"{', '.join(map(repr, strange[:5]))} are not ids of datasets")
    if len(set(listed)) != len(listed):
        raise _wrong(address, "an id is listed twice")
    return tuple(sorted(listed))


def _wrong(address: str, problem: str) -> HubError:
    return HubError(
        f"{address}/{INDEX_FILE} cannot be used: {problem}. The next `swarmdata push` to "
        "this remote writes it anew."
    )
