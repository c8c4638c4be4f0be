"""Names that users give to robots, policies and tiers: plain ASCII, and no way out of a folder."""

import re
from collections import Counter
from collections.abc import Iterable
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field

MAX_TEXT = 10_000  # most characters in free text

_VERSION = re.compile(r"-v[0-9]+(?=@|\Z)")
_RESERVED = re.compile(r"(?:con|prn|aux|nul|com[0-9]|lpt[0-9])(?:\..*)?", re.IGNORECASE)


class _Form(NamedTuple):
    """What one kind of name looks like."""

    pattern: re.Pattern[str]
    most: int  # characters
    what: str
    expected: str  # after the number of characters

    def fits(self, text: str) -> bool:
        """Whether a text has this form and length, is no path, and names no device."""
        if len(text) > self.most or not self.pattern.fullmatch(text) or ".." in text:
            return False
        return all(part.strip() and not _RESERVED.fullmatch(part) for part in text.split("/"))

    def checked(self, text: str) -> str:
        """Returns the text; raises ValueError if it has another form."""
        if not self.fits(text):
            raise ValueError(
                f"{text!r:.100} is {self.what}, expected at most {self.most} of the {self.expected}"
            )
        return text


_NAME = _Form(
    re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9_.:+ -]*[A-Za-z0-9_+])?"),
    48,
    "no name",
    "characters A-Z a-z 0-9 space and _ - . : +, a letter or digit first, no two dots in a row and "
    "no name that Windows reserves, such as robot or left-arm_2",
)
_LABEL = _Form(  # edits put the ids of datasets before the labels of parents
    re.compile(r"[A-Za-z0-9_](?:[A-Za-z0-9_.,:;=+*@#%()/\[\] -]*[A-Za-z0-9_+*%)\]])?"),
    256,
    "no label",
    "characters A-Z a-z 0-9 space and _ - . , : ; = + * @ # % ( ) / [ ], a letter, a digit or _ "
    "first, no two dots in a row, no empty part between slashes and no name that Windows reserves, "
    "such as expert-0",
)
_FILE_NAME = _Form(
    re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]*[A-Za-z0-9]"),
    128,
    "not the name of a file",
    "characters A-Z a-z 0-9 _ - . +, a letter or digit first and last, no two dots in a row, no "
    "folder and no name that Windows reserves, such as coop_nav-expert-0.safetensors",
)

checked_label, checked_file_name = _LABEL.checked, _FILE_NAME.checked
is_file_name = _FILE_NAME.fits


def _checked_text(text: str) -> str:
    strange = next((each for each in text if not (each.isprintable() or each in "\n\t")), "")
    if strange or len(text) > MAX_TEXT:
        held = f" with the character {strange!r}" if strange else ""
        raise ValueError(
            f"text of {len(text):,} characters{held}, expected at most {MAX_TEXT:,}, all printable"
        )
    return text


Name = Annotated[str, AfterValidator(_NAME.checked)]
"""Name of a robot or a role: a column, a key of a dictionary, part of a file name."""

Label = Annotated[str, AfterValidator(checked_label)]
"""Name of a policy, a tier or an ingredient: a cell of a table, a key of a dictionary."""

FileName = Annotated[str, AfterValidator(checked_file_name)]
"""Name of a file in a known folder; never a path."""

Text = Annotated[str, AfterValidator(_checked_text)]
"""Free text of an author, which only people read."""

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]  # SHA-256 of a file or a dataset, hex


def without_version(dataset_id: str) -> str:
    """A dataset's id without its version, `coop_nav-medium`; a view's `coop_nav-medium@1f`."""
    return _VERSION.sub("", dataset_id)


def repeated(names: Iterable[str]) -> list[str]:
    """Names that occur more than once, sorted."""
    return sorted(name for name, n in Counter(names).items() if n > 1)
