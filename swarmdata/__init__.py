"""Offline multi-agent RL datasets for multi-robot tasks.

    >>> import swarmdata
    >>> dataset = swarmdata.load("coop_nav-medium-mini")
    >>> batch = next(dataset.sampler(256, seed=0))

Every name that the documentation uses is here. A name is loaded when it is first used, so that
`import swarmdata` costs nothing: it loads neither NumPy, pydantic, zarr, numba, Pymunk nor torch.
The types of all errors are in `swarmdata.errors`.
"""

import ast
from importlib import import_module
from pathlib import Path
from typing import Any

__version__ = "0.2.0"

_HOMES = {
    name.name: node.module
    for node in ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")).body
    if isinstance(node, ast.ImportFrom)
    for name in node.names
}
"""Where each public name is defined, as `__init__.pyi` says, which is also what types are from."""

__all__ = sorted(_HOMES)  # noqa: PLE0605


def __getattr__(name: str) -> Any:
    """Imports a public name on first use (PEP 562)."""
    if name not in _HOMES:
        raise AttributeError(f"module 'swarmdata' has no attribute {name!r}")
    value = getattr(import_module(str(_HOMES[name])), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names."""
    return [*__all__, "__version__"]
