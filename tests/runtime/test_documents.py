"""Documents: what they may hold, the places of errors, and that reading is bounded."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SpecError
from swarmdata.runtime.documents import (
    MAX_DEPTH,
    MAX_JSON_BYTES,
    MAX_YAML_BYTES,
    parse_document,
    parse_json,
    read_document,
)
from swarmdata.runtime.yaml_documents import MAX_VALUES, parse_yaml

VALUES = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(2**63), 2**63)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs"]), max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text("abc<", max_size=3), inner),
    max_leaves=12,
)


@given(value=VALUES)
def test_what_pyyaml_writes_is_read(value: Any) -> None:
    if isinstance(value, dict) and "<<" in value:
        return
    assert parse_yaml(yaml.safe_dump(value, allow_unicode=True), "x") == value


@given(text=st.text(max_size=200) | st.binary(max_size=100))
def test_any_text_is_a_document_or_one_error(text: str | bytes) -> None:
    for parse in (parse_yaml, parse_json, parse_document):
        assert error_of(parse, text).startswith("x ") or not error_of(parse, text)


def error_of(parse: Callable[[str | bytes, str], Any], text: str | bytes) -> str:
    try:
        parse(text, "x")
    except SpecError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("a: 2024-01-01", {"a": "2024-01-01"}),
        ("a: 5e-05", {"a": 5e-05}),
        ("a: 0x10", {"a": 16}),
        ("a: &x [1, 2]\nb: *x", {"a": [1, 2], "b": [1, 2]}),
        ("\ufeffa: 1", {"a": 1}),
        ("", None),
        ("a: 18446744073709551615", {"a": 2**64 - 1}),
        ("a: '<<'\n'<<': 1", {"a": "<<", "<<": 1}),
        ("a:", {"a": None}),
    ],
)
def test_values_are_those_of_json(text: str, value: Any) -> None:
    assert parse_yaml(text, "x") == value


@pytest.mark.parametrize("text", ["010", "-007", "1:30", "1:30.5", "0b11", "yes", "No", "OFF"])
def test_what_versions_of_yaml_read_differently_is_refused(text: str) -> None:
    assert "which versions of YAML read differently" in error_of(parse_yaml, f"a: {text}")
    assert parse_yaml(f"a: '{text}'", "x") == {"a": text}


def test_values_that_are_repeated_are_not_shared() -> None:
    read = parse_yaml("a: &x [1]\nb: *x", "x")
    read["a"].append(2)
    assert read["b"] == [1]


@pytest.mark.slow
def test_as_much_as_is_allowed_is_read() -> None:
    assert len(parse_yaml("- 1\n" * (MAX_VALUES - 1), "x")) == MAX_VALUES - 1
    with pytest.raises(SpecError, match=rf"line {MAX_VALUES}, column 3: there are more than"):
        parse_yaml("- 1\n" * MAX_VALUES, "x")
    for parse in (parse_yaml, parse_json):
        parse("[" * MAX_DEPTH + "]" * MAX_DEPTH, "x")
        with pytest.raises(SpecError, match=f"deeper than {MAX_DEPTH}, the most allowed"):
            parse("[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "x")


@pytest.mark.parametrize("text", ["{}" * 1, "[1, 2]", '{"a": [1.5, "x", null, true]}'])
def test_json_is_read_by_either(text: str) -> None:
    assert parse_json(text, "x") == parse_yaml(text, "x") == parse_document(text, "x")


def test_large_json_is_read_and_yaml_of_that_size_is_not() -> None:
    text = '{"a": [' + ",".join(map(str, range(100_000))) + "]}"
    assert len(parse_document(text, "x")["a"]) == 100_000
    with pytest.raises(SpecError, match=f"expected at most {MAX_YAML_BYTES}"):
        parse_document(text.replace('"', ""), "x")
    with pytest.raises(SpecError, match="more than 400000 lists and mappings"):
        parse_json("[" + ",".join(["[]"] * 400_000) + "]", "x")


def test_the_place_of_an_error_in_json_is_named() -> None:
    with pytest.raises(SpecError, match="x is not JSON: line 2, column 7: a number of 70 charact"):
        parse_json('{"a":\n  [1, ' + "7" * 70 + "]}", "x")
    with pytest.raises(SpecError, match="x is not JSON: line 1, column 6: Expecting"):
        parse_json('{"a":}', "x")


def test_files_are_read_by_their_suffix(tmp_path: Path) -> None:
    for name, text in {"a.yaml": "a: 1", "a.yml": "{a: 1}", "a.json": '{"a": 1}'}.items():
        (tmp_path / name).write_text(text)
        assert read_document(tmp_path / name) == {"a": 1}
    (tmp_path / "b.json").write_text("a: 1")
    with pytest.raises(SpecError, match=r"b\.json is not JSON: line 1, column 1"):
        read_document(tmp_path / "b.json")


@pytest.mark.parametrize(("name", "size"), [("a.yaml", MAX_YAML_BYTES), ("a.json", MAX_JSON_BYTES)])
def test_a_file_that_is_too_large_is_not_read(tmp_path: Path, name: str, size: int) -> None:
    with (tmp_path / name).open("wb") as file:
        file.truncate(size + 1)
    with pytest.raises(OSError, match=f"has more than {size} bytes"):
        read_document(tmp_path / name)


def test_devices_and_pipes_are_no_documents(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").symlink_to("/dev/zero")
    with pytest.raises(OSError, match="is a device, expected a regular file"):
        read_document(tmp_path / "a.yaml")
