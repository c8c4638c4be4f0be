"""Where datasets come from and what was recorded in them: the protocols `Origin` and `Spec`."""

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
