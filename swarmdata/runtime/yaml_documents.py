"""YAML from outside, read with the bounds of `documents`, which imports this where it is needed."""

import re
from collections.abc import Iterator
from itertools import count
from typing import Any

import yaml

from swarmdata.errors import SpecError
from swarmdata.runtime.documents import (
    MAX_DEPTH,
    MAX_DIGITS,
    MAX_YAML_BYTES,
    check_size,
    decode,
    finite,
    line_and_column,
)

MAX_VALUES = 20_000  # in a text in YAML, keys and the values that aliases repeat included
MAX_INTEGER = (1 << 64) - 1  # largest absolute value of a whole number: seeds take 64 bits


def parse_yaml(text: str | bytes, source: str) -> Any:
    """Returns what text in YAML holds.

    Raises:
        SpecError: it is not YAML, with the place, or exceeds a bound.
    """
    check_size(text, MAX_YAML_BYTES, source)
    decoded, loader = decode(text, source), None
    try:
        loader = _BoundedLoader(decoded)
        node = loader.get_single_node()
        return None if node is None else _value(node, (), count(1))
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = "" if mark is None else f"line {mark.line + 1}, column {mark.column + 1}: "
        problem = ", ".join(filter(None, (error.context, error.problem)))
        raise SpecError(f"{source} is neither YAML nor JSON: {place}{problem}") from error
    except yaml.reader.ReaderError as error:
        raise SpecError(
            f"{source} is neither YAML nor JSON: {line_and_column(decoded, error.position)}the "
            f"character {decoded[error.position]!a}, which YAML does not allow"
        ) from error
    finally:
        if loader is not None:
            loader.dispose()


class _BoundedLoader(yaml.SafeLoader):
    """Composes the nodes of a document of bounded size and depth; it constructs no objects."""

    _depth = _n_values = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        event: Any = self.peek_event()  # type: ignore[no-untyped-call]
        is_inner = isinstance(event, yaml.CollectionStartEvent)
        self._n_values += 1
        if self._n_values > MAX_VALUES:
            raise _error(_TOO_MANY, event.start_mark)
        if is_inner and self._depth == MAX_DEPTH:
            raise _error(_TOO_DEEP, event.start_mark)
        self._depth += is_inner
        node = super().compose_node(parent, index)
        self._depth -= is_inner
        return node


_TOO_MANY = f"there are more than {MAX_VALUES} values, the most allowed"
_TOO_DEEP = f"values are nested deeper than {MAX_DEPTH}, the most allowed"


def _without_dates() -> dict[str, list[tuple[str, Any]]]:
    """Which plain scalars are no text, by their first character."""
    left_out = {"tag:yaml.org,2002:timestamp", "tag:yaml.org,2002:merge", "tag:yaml.org,2002:value"}
    return {
        first: [pair for pair in pairs if pair[0] not in left_out]
        for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
    }


_BoundedLoader.yaml_implicit_resolvers = _without_dates()
# YAML 1.1 reads 5e-05, which JSON writes, as text
_BoundedLoader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+$"),
    list("-+.0123456789"),
)

_KINDS = {"int": "whole number", "float": "finite number", "bool": "boolean", "null": "null"}

_PLAIN = {
    "int": re.compile(r"[-+]?(?:0|[1-9][0-9_]*|0x[0-9a-fA-F_]+)"),
    "float": re.compile("[^:]*"),
    "bool": re.compile("(?i:true|false)"),
}
"""Scalars that YAML 1.1 and 1.2 read alike, or as text; to the former, 010 is 8, 1:30 is 90 and yes
is true."""

_SCALARS = yaml.constructor.SafeConstructor()


def _value(node: yaml.Node, path: tuple[str, ...], number: "count[int]") -> Any:
    """What a node stands for, once for each alias of it."""
    if next(number) > MAX_VALUES:
        raise _error(_TOO_MANY, node.start_mark)
    if len(path) == MAX_DEPTH and isinstance(node, yaml.CollectionNode):
        raise _error(_TOO_DEEP, node.start_mark)
    kind = node.tag.removeprefix("tag:yaml.org,2002:")
    if isinstance(node, yaml.SequenceNode) and kind == "seq":
        return [_value(each, (*path, str(k)), number) for k, each in enumerate(node.value)]
    if isinstance(node, yaml.MappingNode) and kind == "map":
        return dict(_entries(node, path, number))
    if isinstance(node, yaml.ScalarNode) and kind in ("str", "null", "bool", "int", "float"):
        return _scalar(node, kind, path)
    raise _error(
        f"a value tagged {node.tag!r:.100}, expected a mapping, a list, text, a number, a boolean "
        "or null",
        node.start_mark,
        path,
    )


def _entries(
    node: yaml.MappingNode, path: tuple[str, ...], number: "count[int]"
) -> Iterator[tuple[Any, Any]]:
    """Keys and values of a mapping; keys are scalars, each given once."""
    seen = set()
    for key_node, value_node in node.value:
        if not isinstance(key_node, yaml.ScalarNode):
            raise _error(
                "a key that is a mapping or a list, expected text", key_node.start_mark, path
            )
        if key_node.value == "<<" and key_node.style is None:
            problem = "a merge key <<, which is not supported; write the keys out"
            raise _error(problem, key_node.start_mark, path)
        key = _value(key_node, path, number)
        if key in seen:
            raise _error(f"key {key!r:.100} is given twice", key_node.start_mark, path)
        seen.add(key)
        yield key, _value(value_node, (*path, str(key)), number)


def _scalar(node: yaml.ScalarNode, kind: str, path: tuple[str, ...]) -> Any:
    text: str = node.value
    if kind == "str":
        if not text.isascii() and re.search("[\ud800-\udfff]", text):
            raise _error("half a character (a lone surrogate)", node.start_mark, path)
        return text
    if kind in ("int", "float") and len(text) > MAX_DIGITS:
        problem = f"a number of {len(text)} characters, expected at most {MAX_DIGITS}"
        raise _error(problem, node.start_mark, path)
    construct = getattr(_SCALARS, f"construct_yaml_{kind}")
    try:
        value = construct(node)
        if kind == "float":
            finite(str(value))
    except (ValueError, KeyError, IndexError, OverflowError) as error:
        problem = f"{text!r:.100} is no {_KINDS[kind]}"
        raise _error(problem, node.start_mark, path) from error
    if kind in _PLAIN and not _PLAIN[kind].fullmatch(text):
        problem = f"{text!r:.99}, which versions of YAML read differently, expected true, false or "
        problem += "a decimal number without colons and leading zeros; text stands in quotes"
        raise _error(problem, node.start_mark, path)
    if kind == "int" and abs(value) > MAX_INTEGER:
        raise _error(
            f"the whole number {text:.100}, expected at most 2**64 - 1", node.start_mark, path
        )
    return value


def _error(problem: str, mark: yaml.Mark, path: tuple[str, ...] = ()) -> yaml.MarkedYAMLError:
    where = f"{'.'.join(path)}: {problem}" if path else problem
    return yaml.MarkedYAMLError(problem=f"{where:.400}", problem_mark=mark)
