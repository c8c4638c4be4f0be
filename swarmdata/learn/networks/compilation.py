"""fusable and fused: pure functions of tensors that one switch compiles.

    @fusable
    def _critic_gradient(self, batch, noise): ...  # loss, and network.backward(loss.sum())

    with fused() as fusion:
        algorithm.update(batch)
    print(fusion)  # compiled 3 graphs in 21 s

Outside `fused` such a function runs as it is written. Inside, torch.compile makes one graph of it,
with its backward pass, for each new combination of shapes and constants; it needs a C++ compiler.
What lies between two matrix products then reads and writes memory once. Results agree within
rounding.

A function may be fusable if it draws no random numbers, changes nothing but gradients, and what is
not a tensor among its arguments (and the attributes that it reads) takes few values.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cache, wraps
from typing import Any, ParamSpec, TypeVar

import torch
from torch import Tensor

from swarmdata.errors import ProgramError

P = ParamSpec("P")
R = TypeVar("R")

BACKEND = "inductor"
"""Torch's name for what compiles graphs; tests take "eager", which runs them as they are."""

SPECIALIZATIONS = 256
"""Combinations a function may be compiled for; torch's 8 is soon used up in a sweep."""


@dataclass
class Fusion:
    """What was compiled so far inside one `fused`."""

    n_graphs: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        """As a user is told."""
        return f"compiled {self.n_graphs} graphs in {self.seconds:.0f} s"


_FUSION: ContextVar[Fusion | None] = ContextVar("fusion", default=None)


def fusable(function: Callable[P, R]) -> Callable[P, R]:
    """Makes a pure function of tensors one that `fused` compiles."""

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        chosen = function if _FUSION.get() is None else _compiled(function)
        return chosen(*args, **kwargs)

    setattr(run, "is_fusable", True)  # noqa: B010 (functions have no such attribute for mypy)
    return run


def has_fusable(kind: type) -> bool:
    """Whether a class has methods that `fused` compiles."""
    return any(getattr(value, "is_fusable", False) for value in vars(kind).values())


@contextmanager
def fused() -> Iterator[Fusion]:
    """Compiles fusable functions while it is open; yields what that has cost so far.

    Raises:
        ProgramError: torch.compile does not work here; the message says why.
    """
    from torch._dynamo import config  # noqa: PLC0415  (takes a second)

    fusion = Fusion()
    # the older name of torch's `recompile_limit`, which newer releases know as well
    settings: dict[str, Any] = {"cache_size_limit": SPECIALIZATIONS}
    if _traces_gradients():
        settings["trace_autograd_ops"] = True
    token = _FUSION.set(fusion)
    try:
        with config.patch(settings):
            _probe()
            yield fusion
    finally:
        _FUSION.reset(token)


@contextmanager
def unfused() -> Iterator[None]:
    """Runs fusable functions as they are written while it is open, also inside `fused`."""
    token = _FUSION.set(None)
    try:
        yield
    finally:
        _FUSION.reset(token)


@fusable
def _twice(values: Tensor) -> Tensor:
    return values + values


def _probe() -> None:
    """Compiles a small function, so that a machine without a compiler says so at once."""
    try:
        _twice(torch.ones(2))
    except Exception as error:  # torch has a dozen types for it, most of them private
        reason = " ".join(str(error).split("\n\n")[0].split()) or "no message"
        raise ProgramError(
            f"torch.compile does not work here: {type(error).__name__}: {reason} "
            "It needs a C++ compiler: install g++ or clang, or name one in the environment "
            "variable CXX; or train without compiling."
        ) from error


def _traces_gradients() -> bool:
    """Whether this torch can put a backward pass into the same graph; 2.13 can, 2.4 makes two."""
    from torch._dynamo import config  # noqa: PLC0415  (takes a second)

    return hasattr(config, "trace_autograd_ops")


@cache
def _compiled(function: Callable[P, R]) -> Callable[P, R]:
    # with fullgraph, what cannot be compiled is an error, and not slow in silence
    return torch.compile(function, backend=_backend, dynamic=False, fullgraph=_traces_gradients())


def _backend(graph: Any, inputs: list[Tensor]) -> Any:
    """Compiles a graph with `BACKEND`; counts and times it."""
    from torch._dynamo import lookup_backend  # noqa: PLC0415  (takes a second)

    begin = time.perf_counter()
    kernels = lookup_backend(BACKEND)(graph, inputs)
    fusion = _FUSION.get()
    if fusion is not None:
        fusion.n_graphs += 1
        fusion.seconds += time.perf_counter() - begin
    return kernels
