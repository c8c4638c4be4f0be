"""compilable and compiling: pure functions of tensors that one switch compiles.

    @compilable
    def _critic_gradient(self, batch, noise): ...  # loss, and network.backward(loss.sum())

    with compiling() as compilation:
        algorithm.update(batch)

Inside `compiling`, torch.compile makes one graph of such a function, with its backward pass, for
each new combination of shapes and constants; results agree within rounding. A function may be
compilable if it draws no random numbers and changes nothing but gradients. Its arguments that are
not tensors, and the attributes it reads, may take only a few values.
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
"""Torch's name of its graph compiler; tests use "eager", which runs graphs as they are."""

SPECIALIZATIONS = 256
"""Combinations that a function may be compiled for; a sweep soon exceeds torch's default of 8."""


@dataclass
class Compilation:
    """Number of graphs compiled inside one `compiling`, and the time it took."""

    n_graphs: int = 0
    seconds: float = 0.0

    def __str__(self) -> str:
        return f"compiled {self.n_graphs} graphs in {self.seconds:.0f} s"


_COMPILATION: ContextVar[Compilation | None] = ContextVar("compilation", default=None)


def compilable(function: Callable[P, R]) -> Callable[P, R]:
    """Marks a pure function of tensors as one that `compiling` compiles."""

    @wraps(function)
    def run(*args: P.args, **kwargs: P.kwargs) -> R:
        chosen = function if _COMPILATION.get() is None else _compiled(function)
        return chosen(*args, **kwargs)

    setattr(run, "is_compilable", True)  # noqa: B010 (functions have no such attribute for mypy)
    return run


def has_compilable(kind: type) -> bool:
    """Whether a class has methods that `compiling` compiles."""
    return any(getattr(value, "is_compilable", False) for value in vars(kind).values())


@contextmanager
def compiling() -> Iterator[Compilation]:
    """Compiles compilable functions while it is open; yields the cost so far."""
    from torch._dynamo import config  # noqa: PLC0415  (takes a second)

    compilation = Compilation()
    # the older name of torch's `recompile_limit`, which newer releases know as well
    settings: dict[str, Any] = {"cache_size_limit": SPECIALIZATIONS}
    if _traces_gradients():
        settings["trace_autograd_ops"] = True
    token = _COMPILATION.set(compilation)
    try:
        with config.patch(settings):
            _probe()
            yield compilation
    finally:
        _COMPILATION.reset(token)


@contextmanager
def uncompiled() -> Iterator[None]:
    """Runs compilable functions uncompiled while it is open, even inside `compiling`."""
    token = _COMPILATION.set(None)
    try:
        yield
    finally:
        _COMPILATION.reset(token)


@compilable
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
    compilation = _COMPILATION.get()
    if compilation is not None:
        compilation.n_graphs += 1
        compilation.seconds += time.perf_counter() - begin
    return kernels
