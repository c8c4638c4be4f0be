"""Names that others give: of robots, policies and tiers, which become keys, cells and columns.

Only plain ASCII is allowed: a name that looks like another, holds a control character or could
leave a folder has no use.
"""

import re
from collections import Counter
from collections.abc import Iterable
from typing import Annotated

from pydantic import AfterValidator, Field

MAX_NAME = 48
"""Characters of the name of a robot or of a role."""

MAX_LABEL = 256
"""Characters of a label: an edit puts the ids of datasets before those it found."""

MAX_FILE_NAME = 128
"""Characters of the name of a file."""

MAX_TEXT = 10_000
"""Characters of free text."""

_NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_.:+ -]*[A-Za-z0-9_+])?")
_LABEL = re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_.,:;=+*@#%()/\[\] -]*[A-Za-z0-9_+*%)\]])?")
_FILE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*[A-Za-z0-9]")
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
    """Returns a text that is a label.

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
    """Whether a text has the form and the length, leads nowhere, and names no device."""
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
"""Of a robot or of a role: a column, a key of a dictionary, part of the name of a file."""

Label = Annotated[str, AfterValidator(checked_label)]
"""Of a policy, a tier or an ingredient: a cell of a table, a key of a dictionary."""

Text = Annotated[str, AfterValidator(_checked_text)]
"""Free text of one who made something, which only people read."""


Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
"""Of a file or of a dataset."""


def checked_file_name(text: str) -> str:
    """Returns a text that is the name of a file, and no path.

    Raises:
        ValueError: it is not.
    """
    if not _is_plain(text, _FILE_NAME, MAX_FILE_NAME):
        raise ValueError(
            f"{text!r:.100} is not the name of a file, expected at most {MAX_FILE_NAME} of the "
            "characters A-Z a-z 0-9 _ - . +, a letter or digit first and last, no two dots in a "
            "row, no folder and no name that Windows reserves, such as "
            "coop_nav-expert-0.safetensors"
        )
    return text


FileName = Annotated[str, AfterValidator(checked_file_name)]
"""Of a file in a folder that we know; never a path."""


def repeated(names: Iterable[str]) -> list[str]:
    """Names that come more than once, sorted."""
    return sorted(name for name, n in Counter(names).items() if n > 1)
