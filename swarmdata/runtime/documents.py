"""YAML and JSON from outside, with JSON's kinds alone, bounds, and errors that name the place."""

import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from swarmdata.errors import SpecError
from swarmdata.runtime.regular_files import read_regular

MAX_YAML_BYTES = 1 << 18  # of a text in YAML: reading them takes some seconds

MAX_JSON_BYTES = 1 << 24
"""Of a text in JSON, bytes: a recipe that lists a million episodes has half of it."""

MAX_DEPTH = 32  # of mappings and sequences inside each other
MAX_CONTAINERS = 400_000  # mappings and sequences in a text in JSON
MAX_DIGITS = 64  # characters of a number


def read_document(path: Path) -> Any:
    """Returns what a `.json` file, or else a YAML file, holds.

    Raises:
        OSError: the file cannot be read, is no regular file, or is too large.
        SpecError: it is not a document, with the place.
    """
    is_json = path.suffix == ".json"
    content = read_regular(path, MAX_JSON_BYTES if is_json else MAX_YAML_BYTES)
    return parse_json(content, str(path)) if is_json else _parse_yaml(content, str(path))


def parse_document(text: str | bytes, source: str) -> Any:
    """Returns what text in YAML, or in JSON as this library writes it, holds.

    Raises:
        SpecError: it is not a document, with the place.
    """
    start = text[:64].lstrip()
    if start[:2] in ('{"', b'{"'):  # YAML may begin so as well, and takes its time
        try:
            return parse_json(text, source)
        except _MalformedError:
            pass
    return _parse_yaml(text, source)


def _parse_yaml(text: str | bytes, source: str) -> Any:
    from swarmdata.runtime.yaml_documents import parse_yaml  # noqa: PLC0415  (a load reads none)

    return parse_yaml(text, source)


class _MalformedError(SpecError):
    """The text is not JSON at all."""


def parse_json(text: str | bytes, source: str, most: int = MAX_JSON_BYTES) -> Any:
    """Returns what text in JSON of at most so many bytes holds.

    Raises:
        SpecError: it is not JSON, with the place, or exceeds a bound.
    """
    check_size(text, most, source)
    decoded = decode(text, source)
    if decoded.count("[") + decoded.count("{") > MAX_CONTAINERS:
        raise SpecError(
            f"{source} has more than {MAX_CONTAINERS} lists and mappings, the most allowed."
        )
    try:
        data = json.loads(decoded, **_HOOKS)
    except json.JSONDecodeError as error:
        raise _MalformedError(
            f"{source} is not JSON: line {error.lineno}, column {error.colno}: {error.msg}"
        ) from error
    except RecursionError as error:
        raise SpecError(f"{source} is nested too deeply for JSON.") from error
    except ValueError as error:
        at = decoded.find(error.text) if isinstance(error, _NumberError) else None
        where = "" if at is None else line_and_column(decoded, at)
        raise SpecError(f"{source} is not JSON: {where}{error}") from error
    if decoded.count("[") + decoded.count("{") > MAX_DEPTH:
        _check_depth(data, source)
    if r"\u" in decoded:
        try:
            json.dumps(data, ensure_ascii=False).encode()
        except UnicodeEncodeError as error:
            raise SpecError(f"{source} has half a character (a lone surrogate): {error}") from error
    return data


def check_size(text: str | bytes, most: int, source: str) -> None:
    """Refuses text of more than `most` characters."""
    if len(text) > most:
        raise SpecError(f"{source} has {len(text)} characters, expected at most {most}.")


def decode(text: str | bytes, source: str) -> str:
    """Returns text of UTF-8 with no half characters."""
    try:
        decoded = text.decode("utf-8-sig") if isinstance(text, bytes) else text
        decoded.encode("utf-8")
    except UnicodeError as error:
        raise SpecError(f"{source} is not UTF-8: {error}") from error
    return decoded


def unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The pairs of a mapping in JSON; ValueError if a key is given twice."""
    result = dict(pairs)
    if len(result) != len(pairs):
        twice = next(key for key, n in Counter(key for key, _ in pairs).items() if n > 1)
        raise ValueError(f"key {twice!r:.100} is given twice")
    return result


class _NumberError(ValueError):
    """A number that no spec needs."""

    def __init__(self, problem: str, text: str) -> None:
        super().__init__(problem)
        self.text = text


def finite(text: str) -> float:
    """Returns a number that is neither infinite nor undefined."""
    value = float(text)
    if not math.isfinite(value):
        raise _NumberError(f"{text:.100} is not a finite number", text)
    return value


def _whole(text: str) -> int:
    if len(text) > MAX_DIGITS:
        problem = f"a number of {len(text)} characters, expected at most {MAX_DIGITS}"
        raise _NumberError(problem, text)
    return int(text)


_HOOKS: Any = {
    "object_pairs_hook": unique_keys,
    "parse_constant": finite,
    "parse_float": finite,
    "parse_int": _whole,
}


def _check_depth(data: Any, source: str) -> None:
    level, containers = [data], {dict, list}
    for _ in range(MAX_DEPTH):
        inside = (each.values() if isinstance(each, dict) else each for each in level)
        # of the lists of a result, nearly all are of numbers only: no step in Python for each
        deeper = (values for values in inside if not containers.isdisjoint(map(type, values)))
        level = [each for values in deeper for each in values if type(each) in containers]
        if not level:
            return
    raise SpecError(f"{source} is nested deeper than {MAX_DEPTH}, the most allowed.")


def line_and_column(text: str, at: int) -> str:
    """Where a character of a text is, for the beginning of a sentence."""
    return f"line {text.count(chr(10), 0, at) + 1}, column {at - text.rfind(chr(10), 0, at)}: "
