"""Finding and Audit, the results of the checks of a dataset, as data and as text."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Literal

Level = Literal["problem", "note"]
Remark = tuple[Level, str]  # one result of a check, still without the check's name
Remarks = Iterator[Remark]


def problem(message: str) -> Remark:
    """Something is wrong with the dataset."""
    return "problem", message


def note(message: str) -> Remark:
    """Something worth knowing, such as why a check does not apply."""
    return "note", message


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that an audit found."""

    check: str  # name of the check in `audit.CHECKS`
    level: Level  # `problem` if the dataset should not be used or published as it is, else `note`
    message: str  # what is wrong, where, and what was expected

    def __str__(self) -> str:
        return f"{self.level}: {self.check}: {self.message}"


@dataclass(frozen=True, slots=True)
class Audit:
    """Everything that the checks of one dataset found."""

    dataset: str  # id of the dataset
    digest: str  # its logical digest, which identifies the audited content
    checks: tuple[str, ...]  # names of the checks that ran
    findings: tuple[Finding, ...]  # in the order of the checks

    @property
    def problems(self) -> tuple[Finding, ...]:
        return tuple(each for each in self.findings if each.level == "problem")

    def to_text(self) -> str:
        """One line for each finding, then a summary, for people."""
        n = len(self.problems)
        clean = "no problems" if not n else f"{n} problem{'s' if n > 1 else ''}"
        summary = f"{self.dataset} (digest {self.digest[:12]}): {len(self.checks)} checks, {clean}"
        return "".join(f"{line}\n" for line in (*self.findings, summary))

    def to_json(self) -> str:
        """The same as a JSON object, for programs."""
        content = {**asdict(self), "n_problems": len(self.problems)}
        return json.dumps(content, indent=1, allow_nan=False)
