"""Optional packages: a clear error before the work begins."""

from importlib.util import find_spec

from swarmdata.errors import MissingExtraError


def require_extra(package: str, extra: str, purpose: str) -> None:
    """Raises MissingExtraError unless the package is installed; imports nothing."""
    if find_spec(package) is None:
        raise MissingExtraError(package, extra, purpose)
