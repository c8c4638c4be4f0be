"""Ids and file names from outside."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import AddressError
from swarmdata.runtime.outside_names import hostile_names, is_id, split_id, unsafe_names


@given(st.text(max_size=120))
def test_what_is_an_id_is_safe_everywhere(text: str) -> None:
    if is_id(text):
        assert not unsafe_names([text])
        assert text.isascii()
        assert "-".join(split_id(text)) == text
    else:
        with pytest.raises(AddressError, match="is not the id of a dataset"):
            split_id(text)


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        (["../x"], "plain"),
        (["a/../../x"], "plain"),
        (["/etc/passwd"], "plain"),
        (["C:\\x"], "plain"),
        (["C:x"], "plain"),
        (["a\\..\\x"], "plain"),
        (["a//b"], "plain"),
        (["a/"], "plain"),
        ([""], "plain"),
        ([".hidden"], "plain"),
        (["a\n"], "plain"),
        (["a\x00b"], "plain"),
        (["aux"], "plain"),
        (["data.zarr/NUL.json"], "plain"),
        (["ä"], "plain"),
        (["x" * 241], "longer"),
        (["a", "a"], "same file"),
        (["data/A", "data/a"], "same file"),
    ],
)
def test_unsafe_names(names: list[str], problem: str) -> None:
    (found,) = unsafe_names(["recipe.json", *names])
    assert problem in found


@pytest.mark.parametrize(
    "name", ["../x", "a/../b", "/x", "C:\\x", "c:x", "a\\b", "", "a//b", "./a", "a\x00", "a/"]
)
def test_hostile_names(name: str) -> None:
    assert hostile_names([name, "LICENSE"])


def test_names_that_people_use_are_not_hostile() -> None:
    assert hostile_names([".gitattributes", "pictures/my robot ü.png", "LICENSE"]) == ()
    assert hostile_names(["readme.md", "README.md"])
