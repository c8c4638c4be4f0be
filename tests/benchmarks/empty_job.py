"""A job that does nothing, for the overhead of engines; imports only what an engine needs."""

from typing import Any

from swarmdata.runtime.engines.jobs import Handler, Report


def work() -> Handler:
    """Returns what does nothing."""

    def handle(payload: dict[str, Any], report: Report) -> None:
        report(1)

    return handle
