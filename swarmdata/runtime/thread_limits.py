"""ThreadLimit, how many threads the matrix products of NumPy and torch may use."""

from collections.abc import Sequence

from threadpoolctl import ThreadpoolController


class ThreadLimit:
    """A context in which BLAS and OpenMP, and so NumPy's and torch's products, use few threads.

    The networks of policies are too small to gain from a second thread, and waiting threads spin:
    on a busy machine a second thread cost twenty times the processor time. The libraries are looked
    for once, when the limit is made, which takes milliseconds; those loaded later are not limited.
    A limit can be entered again after it was left.

    Args:
        n_threads: how many, at least 1.
    """

    def __init__(self, n_threads: int = 1) -> None:
        self._n_threads = n_threads
        self._libraries = ThreadpoolController().lib_controllers
        self._before: list[int] = []

    def __enter__(self) -> None:
        # `ThreadpoolController.limit` does the same, in 13 us instead of 1: too slow for every step
        self._before = [library.get_num_threads() for library in self._libraries]
        self._set([self._n_threads] * len(self._before))

    def __exit__(self, *_: object) -> None:
        """Restores the numbers of before."""
        self._set(self._before)

    def _set(self, numbers: Sequence[int]) -> None:
        for library, n_threads, before in zip(self._libraries, numbers, self._before, strict=True):
            if before != self._n_threads:
                library.set_num_threads(n_threads)
