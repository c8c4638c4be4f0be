"""Failures, the one rule of commands that do several things: a bad item never sinks the others."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

from swarmdata.errors import BatchError, DiskFullError, SwarmdataError


@dataclass
class Failures:
    """Which items of a batch failed, and why.

    A full disk ends the batch, for the next item needs the same space, and so does Ctrl-C. The
    error of a batch's only item is raised as it is.
    """

    n_items: int  # of the batch
    tell: Callable[[str], None] = lambda text: None
    """Gets a line about each failure when it happens."""
    reasons: dict[str, str] = field(default_factory=dict)  # why items failed, by name

    def item(self, name: str) -> AbstractContextManager[None, bool]:
        """A block that does what belongs to one item; an error is noted and ends the block only."""
        return self._item(name)  # type: ignore[return-value]  # it is not known to end errors

    @contextmanager
    def _item(self, name: str) -> Iterator[None]:
        try:
            yield
        except DiskFullError:
            raise
        except Exception as error:  # a user's own task or algorithm may raise anything
            if self.n_items == 1:
                raise
            self.note(name, error)

    def note(self, name: str, error: Exception) -> None:
        """Notes that an item failed."""
        is_ours = isinstance(error, SwarmdataError)
        reason = str(error) if is_ours else f"{type(error).__name__}: {error}"
        reason = reason.removeprefix(f"{name} failed: ").removeprefix("BuildError: ")
        self.reasons[name] = reason
        self.tell(f"failed: {name}: {reason}")

    def check(self, what: str, advice: str = "The others are done.") -> None:
        """Ends a batch of `what`, such as "datasets"; `advice` says what is kept, and what to do.

        Raises:
            BatchError: items failed; it names them all.
        """
        if self.reasons and self.n_items == 1:
            ((name, reason),) = self.reasons.items()
            raise BatchError(f"{name} failed: {reason}")
        if self.reasons:
            listed = "; ".join(f"{name}: {reason}" for name, reason in self.reasons.items())
            raise BatchError(
                f"{len(self.reasons)} of {self.n_items} {what} failed: {listed}"
                f"{'' if listed.endswith('.') else '.'} {advice}"
            )
