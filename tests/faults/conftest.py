"""Remotes and servers are those of tests/hub/remotes."""

from tests.hub.remotes.conftest import (  # noqa: F401  # fixtures
    backoff,
    beside,
    clock,
    dataset,
    host,
    hub,
    impatient,
    published,
    remote,
    successor,
)
