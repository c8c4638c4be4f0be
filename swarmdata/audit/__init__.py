"""The audit: whether a dataset is what it says, whoever made it."""

from swarmdata.audit.checks import CHECKS, audit, contradictions, problems_of
from swarmdata.audit.findings import Audit, Finding

__all__ = ["CHECKS", "Audit", "Finding", "audit", "contradictions", "problems_of"]
