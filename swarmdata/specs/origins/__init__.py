"""Where datasets come from and what was recorded in them; `origin_kinds` and `spec_kinds` list all.

To add a kind of origin, write a class that keeps the protocol `Origin`, in a file of its own, and
add a row to `ORIGIN_KINDS`. Everything else asks the protocol: the store, cards, audits, exports.
A kind's module is imported when data of the kind are read.
"""

from swarmdata.specs.origins.origin_kinds import (
    ORIGIN_KINDS,
    Origin,
    check_installed,
    parse_origin,
    task_of,
)
from swarmdata.specs.origins.recorded_spec import MAX_COLUMNS, RecordedAgent, RecordedSpec
from swarmdata.specs.origins.spec_kinds import SPEC_KINDS, AnySpec, SideSpec, Spec

__all__ = [
    "MAX_COLUMNS",
    "ORIGIN_KINDS",
    "SPEC_KINDS",
    "AnySpec",
    "Origin",
    "RecordedAgent",
    "RecordedSpec",
    "SideSpec",
    "Spec",
    "check_installed",
    "parse_origin",
    "task_of",
]
