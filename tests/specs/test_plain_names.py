"""Names: what is allowed stays what it is, everything else is refused in a sentence."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarmdata.errors import SpecError
from swarmdata.specs.frozen import Frozen
from swarmdata.specs.plain_names import FileName, Label, Name, Text, without_version


class Named(Frozen):
    """One of each."""

    name: Name = "a"
    label: Label = "a"
    file: FileName = "aa"
    text: Text = ""


@pytest.mark.parametrize("name", ["robot", "left-arm_2", "adversary_0", "1", "a.b", "arm:2", "A+"])
def test_plain_names_are_names(name: str) -> None:
    assert Named.parse({"name": name, "label": name}) == Named(name=name, label=name)


@pytest.mark.parametrize(
    "label",
    ["expert-0", "coop_nav-medium-v1/expert-0-2", "PPO (seed 3)", "lr=1e-3, wd=0", "50%", "a/b/c"],
)
def test_what_people_call_policies_is_a_label(label: str) -> None:
    assert Named.parse({"label": label}).label == label


@pytest.mark.parametrize("label", ["a//b", "/a", "a/", "a/ /b", "a/../b", "a/con", " a", "a "])
def test_labels_that_would_leave_a_folder_or_hide_are_refused(label: str) -> None:
    with pytest.raises(SpecError, match="is no label, expected at most 256"):
        Named.parse({"label": label})


@given(text=st.text(max_size=60))
def test_any_text_is_a_name_or_is_refused_in_one_sentence(text: str) -> None:
    for field in ("name", "label", "file", "text"):
        try:
            Named.parse({field: text})
        except SpecError as error:
            assert str(error).isprintable()  # noqa: PT017  (some are right)
        else:
            is_plain = text.isascii() and text.isprintable() and ".." not in text
            assert is_plain or field == "text"


def test_free_text_is_printable_and_bounded() -> None:
    assert Named.parse({"text": "eine Zeile,\nnoch eine: größer"}).text
    with pytest.raises(SpecError, match=r"text of 1 characters with the character '\\x1b', expe"):
        Named.parse({"text": "\x1b"})
    with pytest.raises(SpecError, match="text of 10,001 characters, expected at most 10,000"):
        Named.parse({"text": "a" * 10_001})


@given(st.from_regex(r"[a-z0-9_]{1,9}(-[a-z0-9_]{1,9}){1,3}", fullmatch=True), st.integers(0, 999))
def test_a_version_is_taken_off_whatever_its_number(name: str, version: int) -> None:
    assert without_version(f"{name}-v{version}") == name
    assert without_version(f"{name}-v{version}@1f") == f"{name}@1f"
    assert without_version(f"{name}-v{version}\n") == f"{name}-v{version}\n"
    assert without_version(f"{name}-v{version}-x") == f"{name}-v{version}-x"
