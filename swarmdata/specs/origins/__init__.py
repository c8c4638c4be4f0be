"""Where datasets come from and what was recorded in them; `origin_kinds` and `spec_kinds` list all.

To add a kind of origin, write a class that keeps the protocol `Origin`, in a file of its own, and
add a row to `ORIGIN_KINDS`. Everything else asks the protocol: the store, cards, audits, exports.
"""

from swarmdata.specs.origins.edit_origin import Edit, EpisodeNumber, Parent
from swarmdata.specs.origins.foreign_origin import ForeignOrigin, foreign_origin, missing_parts
from swarmdata.specs.origins.log_map import LogMap
from swarmdata.specs.origins.log_origin import EstimatedClock, ImportedLogs, LogFile
from swarmdata.specs.origins.origin_kinds import (
    ORIGIN_KINDS,
    Origin,
    check_installed,
    parse_origin,
    task_of,
)
from swarmdata.specs.origins.recorded_spec import MAX_COLUMNS, RecordedAgent, RecordedSpec
from swarmdata.specs.origins.recording_origin import Id, Recording
from swarmdata.specs.origins.spec_kinds import SPEC_KINDS, AnySpec, Spec

__all__ = [
    "MAX_COLUMNS",
    "ORIGIN_KINDS",
    "SPEC_KINDS",
    "AnySpec",
    "Edit",
    "EpisodeNumber",
    "EstimatedClock",
    "ForeignOrigin",
    "Id",
    "ImportedLogs",
    "LogFile",
    "LogMap",
    "Origin",
    "Parent",
    "RecordedAgent",
    "RecordedSpec",
    "Recording",
    "Spec",
    "check_installed",
    "foreign_origin",
    "missing_parts",
    "parse_origin",
    "task_of",
]
