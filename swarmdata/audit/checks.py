"""The checks of a dataset in a literal table, and `audit`, which runs them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from tqdm import tqdm

from swarmdata.audit import (
    claim_checks,
    content_checks,
    episode_checks,
    form_checks,
)
from swarmdata.audit.findings import Audit, Finding, Remarks
from swarmdata.audit.replay_checks import replay
from swarmdata.audit.subject import Subject
from swarmdata.specs.origins import check_installed
from swarmdata.store import open_store


class Check(NamedTuple):
    """One check, and the checks without which it cannot run."""

    run: Callable[[Subject], Remarks]
    needs: tuple[str, ...] = ()  # checks that must have found no problem


_SHAPES, _VALUES = ("shapes",), ("shapes", "finite")

CHECKS = {
    "integrity": Check(form_checks.integrity),
    "identity": Check(claim_checks.identity),
    "shapes": Check(form_checks.shapes),
    "finite": Check(form_checks.finite),
    "padding": Check(form_checks.padding, _SHAPES),
    "bounds": Check(form_checks.action_bounds, _SHAPES),
    "masks": Check(form_checks.action_masks, _SHAPES),
    "ends": Check(episode_checks.ends),
    "horizon": Check(episode_checks.horizon),
    "table": Check(episode_checks.table, _VALUES),
    "rewards": Check(content_checks.rewards, _VALUES),
    "seeds": Check(episode_checks.seeds),
    "order": Check(episode_checks.order),
    "splits": Check(episode_checks.splits),
    "statistics": Check(episode_checks.statistics, _VALUES),
    "duplicates": Check(content_checks.duplicates),
    "rows": Check(content_checks.rows),
    "boundaries": Check(content_checks.boundaries),
    "teleports": Check(content_checks.teleports, _VALUES),
    "leaving": Check(content_checks.leaving, _SHAPES),
    "replay": Check(replay, _SHAPES),
    "tiers": Check(claim_checks.tiers, ("finite",)),
    "attributes": Check(claim_checks.attributes),
    "card": Check(claim_checks.card, _VALUES),
}
"""Every check by its name, in the order in which they run."""

_CONTRADICTIONS = ("shapes", "finite", "padding", "bounds", "ends", "leaving")


def audit(
    path: Path | str, *, sample: int = 64, progress: bool = True, only: Sequence[str] = ()
) -> Audit:
    """Checks a dataset of any origin against everything that it claims.

    Arrays are read in blocks, so that memory stays bounded. A check that does not apply to a
    dataset, such as a replay of another library's environment, leaves a note.

    Args:
        path: folder of a finished dataset.
        sample: episodes to replay, divided evenly among the policies; 0 for none. A number of at
            least all episodes replays all.
        progress: whether to show bars on standard error, if that is a terminal.
        only: names of the checks to run; empty: all of them.

    Raises:
        DatasetError: a subclass that names the file that cannot be read.
        SpecError: another package defines what was recorded, and is not installed.
    """
    subject = Subject.of(open_store(Path(path), "none"), sample, progress)
    check_installed(subject.origin, "an audit")
    checks = {name: CHECKS[name] for name in only or CHECKS}
    findings = tuple(_findings(subject, checks))
    return Audit(subject.manifest.id, subject.manifest.digest, tuple(checks), findings)


def problems_of(path: Path | str) -> tuple[str, ...]:
    """The problems that an audit finds, one line each; a dataset with any is not published.

    Raises:
        DatasetError: it cannot be read at all.
    """
    return tuple(f"{each.check}: {each.message}" for each in audit(path).problems)


def contradictions(path: Path | str) -> tuple[str, ...]:
    """What in the arrays of a dataset contradicts its own description, one line each.

    These are the checks of shapes, numbers, spaces and ends. What other checks of an audit find,
    such as episodes that occur twice, may be true of good data.

    Raises:
        DatasetError: it cannot be read at all.
    """
    checks = {name: CHECKS[name] for name in _CONTRADICTIONS}
    found = _findings(Subject.of(open_store(Path(path), "fast"), 0, False), checks)
    return tuple(f"{each.check}: {each.message}" for each in found if each.level == "problem")


def _findings(subject: Subject, checks: Mapping[str, Check]) -> Iterator[Finding]:
    broken: set[str] = set()
    hidden = None if subject.progress else True  # None: hidden where there is no terminal
    with tqdm(checks.items(), unit="check", leave=False, disable=hidden) as bar:
        for name, check in bar:
            bar.set_description(f"audit: {name}")
            lacking = [each for each in check.needs if each in broken]
            if lacking:
                yield Finding(name, "note", f"not checked, because of {' and '.join(lacking)}")
                continue
            for level, message in check.run(subject):
                if level == "problem":
                    broken.add(name)
                yield Finding(name, level, message)
