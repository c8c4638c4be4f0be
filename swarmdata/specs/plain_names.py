"""Names that users give to robots, policies and tiers, which become keys, cells and columns.

Only plain ASCII is allowed, so that no name looks like another, holds a control character or leads
out of a folder.
"""

import re
from collections import Counter
from collections.abc import Iterable
from typing import Annotated

from pydantic import AfterValidator, Field

MAX_NAME = 48
"""Most characters in the name of a robot or a role."""

MAX_LABEL = 256
"""Most characters in a label: edits put the ids of datasets before the labels of parents."""

MAX_FILE_NAME = 128
"""Most characters in the name of a file."""

MAX_TEXT = 10_000
"""Most characters in free text."""

_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_.:+ -]*[A-Za-z0-9_+])?")
_LABEL = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_.,:;=+*@#%()/\[\] -]*[A-Za-z0-9_+*%)\]])?")
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*[A-Za-z0-9]")
_VERSION = re.compile(r"-v[0-9]+(?=@|\Z)")
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\..*)?", re.IGNORECASE)


def _checked_name(text: str) -> str:
    if not _is_plain(text, _NAME, MAX_NAME):
        raise ValueError(
            f"{text!r:.100} is no name, expected at most {MAX_NAME} of the characters A-Z a-z 0-9 "
            "space and _ - . : +, a letter or digit first, no two dots in a row and no name that "
            "Windows reserves, such as robot or left-arm_2"
        )
    return text


def checked_label(text: str) -> str:
    """Returns the text if it is a label.

    Raises:
        ValueError: it is not.
    """
    if not _is_plain(text, _LABEL, MAX_LABEL):
        raise ValueError(
            f"{text!r:.100} is no label, expected at most {MAX_LABEL} of the characters A-Z a-z "
            "0-9 space and _ - . , : ; = + * @ # % ( ) / [ ], a letter, a digit or _ first, no two "
            "dots in a row, no empty part between slashes and no name that Windows reserves, such "
            "as expert-0"
        )
    return text


def _is_plain(text: str, pattern: re.Pattern[str], most: int) -> bool:
    """Whether a text has this form and length, is no path, and names no device."""
    if len(text) > most or not pattern.fullmatch(text) or ".." in text:
        return False
    return all(part.strip() and not _RESERVED.fullmatch(part) for part in text.split("/"))


def _checked_text(text: str) -> str:
    strange = next((each for each in text if not (each.isprintable() or each in "\n\t")), "")
    if strange or len(text) > MAX_TEXT:
        held = f" with the character {strange!r}" if strange else ""
        raise ValueError(
            f"text of {len(text):,} characters{held}, expected at most {MAX_TEXT:,}, all printable"
        )
    return text


Name = Annotated[str, AfterValidator(_checked_name)]
"""Name of a robot or a role: a column, a key of a dictionary, part of a file name."""

Label = Annotated[str, AfterValidator(checked_label)]
"""Name of a policy, a tier or an ingredient: a cell of a table, a key of a dictionary."""

Text = Annotated[str, AfterValidator(_checked_text)]
"""Free text of an author, which only people read."""


Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
"""SHA-256 of a file or a dataset, hex."""


def is_file_name(text: str) -> bool:
    """Whether this is the plain name of a file, and no path."""
    return _is_plain(text, _FILE_NAME, MAX_FILE_NAME)


def checked_file_name(text: str) -> str:
    """Returns the text if it is a file name and no path.

    Raises:
        ValueError: it is not.
    """
    if not is_file_name(text):
        raise ValueError(
            f"{text!r:.100} is not the name of a file, expected at most {MAX_FILE_NAME} of the "
            "characters A-Z a-z 0-9 _ - . +, a letter or digit first and last, no two dots in a "
            "row, no folder and no name that Windows reserves, such as "
            "coop_nav-expert-0.safetensors"
        )
    return text


FileName = Annotated[str, AfterValidator(checked_file_name)]
"""Name of a file in a known folder; never a path."""


def without_version(dataset_id: str) -> str:
    """A dataset's id without its version: `coop_nav-medium` of `coop_nav-medium-v1`.

    The mark of a view stays (`coop_nav-medium@1f`), and so does text that has no version.
    """
    return _VERSION.sub("", dataset_id)


def repeated(names: Iterable[str]) -> list[str]:
    """Names that occur more than once, sorted."""
    return sorted(name for name, n in Counter(names).items() if n > 1)
