"""Whatever a library raises is one error of ours; what our own code raises stays what it is."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from swarmdata.errors import ConversionError, SpecError
from swarmdata.interop.conversion.foreign_file import FREE_BYTES, MOST_EXPANSION, ForeignFile

FAILURES = [AssertionError(), RecursionError("deep"), MemoryError(), OSError(5, "broken\n\x1b[31m")]


@pytest.mark.parametrize("failure", FAILURES, ids=lambda failure: type(failure).__name__)
def test_what_a_library_raises_is_one_line(failure: Exception) -> None:
    source = ForeignFile(Path("monday.bag"), "Try `mend`.")
    source.place = "message 7"
    with pytest.raises(ConversionError) as caught, source.call():
        raise failure
    message = str(caught.value)
    assert message.startswith("monday.bag cannot be read: message 7: ")
    assert type(failure).__name__ in message
    assert message.endswith(". Try `mend`.")
    assert message.isprintable()
    assert caught.value.__cause__ is failure


def test_long_words_are_cut() -> None:
    with pytest.raises(ConversionError) as caught, ForeignFile(Path("a")).call():
        raise ValueError("x" * 10_000)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("failure", [SpecError("ours"), KeyboardInterrupt(), SystemExit(3)])
def test_what_is_no_failure_of_a_library_passes(failure: BaseException) -> None:
    with pytest.raises(type(failure)) as caught, ForeignFile(Path("a")).call():
        raise failure
    assert caught.value is failure


def items() -> Iterator[int]:
    yield 1
    raise KeyError("lost")


def divided(source: ForeignFile, seen: list[int], by: int) -> None:
    for item in source.each(items()):
        seen.append(item // by)  # noqa: PERF401


def test_iterating_is_a_call_and_the_body_of_the_loop_is_not() -> None:
    source, seen = ForeignFile(Path("monday.bag")), list[int]()
    with pytest.raises(ConversionError, match=r"monday\.bag cannot be read: KeyError: 'lost'"):
        divided(source, seen, 1)
    assert seen == [1]
    with pytest.raises(ZeroDivisionError):
        divided(source, seen, 0)
    with pytest.raises(ConversionError, match="not iterable"):
        next(source.each(5))  # type: ignore[arg-type]


def test_what_unfolds_is_bounded(tmp_path: Path) -> None:
    small, large = tmp_path / "small", tmp_path / "large"
    small.write_bytes(b"x")
    with large.open("wb") as file:
        file.truncate(FREE_BYTES)
    source = ForeignFile(small)
    source.take(FREE_BYTES)
    with pytest.raises(ConversionError, match="unfolds to more than"):
        source.take(1)
    source = ForeignFile(large)
    source.take(MOST_EXPANSION * FREE_BYTES)
    with pytest.raises(ConversionError, match="unfolds to more than"):
        source.take(1)
