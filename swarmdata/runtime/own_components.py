"""Components of users: tasks, policies, algorithms and remotes that are not in this package.

They are entry points of installed distributions, or come from `swarmdata.register_...`.
"""

import ast
import hashlib
import inspect
import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points, packages_distributions, version
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from swarmdata.errors import SpecError, SwarmdataError

GROUPS = ("tasks", "policies", "algorithms", "online_algorithms", "remotes")
"""Kinds of components; `swarmdata.tasks` and so on are the groups of entry points."""

REGISTERED_VARIABLE = "SWARMDATA_REGISTERED"
"""Variable of the environment with the registered components of the process that started this one:
JSON, group -> name -> "module:Name"."""

_here: dict[str, dict[str, Any]] = {group: {} for group in GROUPS}


class ComponentTable(Mapping[str, Any]):
    """Components of one kind by name: those of this package, then those of users.

    Values are "module:Name", or the component itself where only this process has it.
    """

    def __init__(self, group: str, own: Mapping[str, str]) -> None:
        self.group, self.own = group, MappingProxyType(dict(own))
        _own_names[group] = frozenset(own)

    def __getitem__(self, name: str) -> Any:
        return self.own[name] if name in self.own else components(self.group)[name]

    def __iter__(self) -> Iterator[str]:
        return iter({**self.own, **components(self.group)})

    def __len__(self) -> int:
        return len(self.own) + len(components(self.group))


_own_names: dict[str, frozenset[str]] = {}


def components(group: str) -> Mapping[str, Any]:
    """Returns the components of users by name: "module:Name", or the component itself.

    Raises:
        SpecError: an installed distribution has a name that is taken.
    """
    inherited = json.loads(os.environ.get(REGISTERED_VARIABLE, "{}")).get(group, {})
    return {**_installed(group), **inherited, **_here[group]}


def register(group: str, name: str, component: Any) -> None:
    """Adds a component under a name, in this process and in the workers that it starts.

    Args:
        group: one of `GROUPS`.
        name: that no component of the package has. Registering a name again replaces the component.
        component: "module:Name", or a class. A class of a script or a notebook is known in this
            process only.

    Raises:
        SpecError: the package has a component of this name, or `component` is neither.
    """
    _check_free(group, name, "register it under another name")
    if not (callable(component) or (isinstance(component, str) and component.count(":") == 1)):
        raise SpecError(
            f"got {component!r} for {name!r}, expected a class, or text such as 'my_package:Name'"
        )
    _here[group][name] = component
    place = component if isinstance(component, str) else _place_of(component)
    known = json.loads(os.environ.get(REGISTERED_VARIABLE, "{}"))
    known.setdefault(group, {})[name] = place
    if place is None:  # nor is what had the name before
        del known[group][name]
    os.environ[REGISTERED_VARIABLE] = json.dumps(known)


def import_component(component: Any) -> Any:
    """Returns the component that "module:Name" names, or the component itself.

    Raises:
        SpecError: there is no such module, or nothing of this name in it.
        ModuleNotFoundError: it needs torch.
    """
    if not isinstance(component, str):
        return component
    module, _, attribute = component.partition(":")
    try:
        return getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        if isinstance(error, SwarmdataError) or getattr(error, "name", None) == "torch":
            raise
        raise SpecError(
            f"{component!r:.100} cannot be imported: {error}. Expected it as module:name, of "
            "a module that is installed or on PYTHONPATH."
        ) from error


def import_function(place: str) -> Callable[..., Any]:
    """Returns the function that "module:name" names.

    Raises:
        SpecError: there is no such module, or no such function in it.
    """
    found = import_component(place)
    if not callable(found):
        raise SpecError(f"{place!r:.100} is {found!r:.100}, expected a function")
    return cast(Callable[..., Any], found)


def defined_elsewhere(what: str, name: str, package: str = "") -> str:
    """Says, in no whole sentence, that something of a kind, such as a task, is not known here."""
    of = f" ({package})" if package else ""
    return f"{what} {name!r:.100}, which is defined by another package{of}: install it"


def package_of(group: str, name: str) -> str | None:
    """The package of a user's component, with its version if it is a distribution; else None."""
    package = _package_of(group, name)
    found = None if package is None else packages_distributions().get(package)
    return f"{found[0]} {version(found[0])}" if found else package


def code_of(group: str, name: str) -> str | None:
    """SHA-256 of the Python files of the package of a user's component; None if there are none."""
    package = _package_of(group, name)
    spec = None if package is None else find_spec(package)
    if spec is None:
        return None
    places = spec.submodule_search_locations  # a folder without __init__.py may be in several
    files = sorted(file for place in places or () for file in Path(place).rglob("*.py"))
    if places is None and spec.origin is not None:
        files = [Path(spec.origin)]
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def own_codes(**used: str) -> dict[str, str]:
    """The hash of the code of each of users' components, of those used.

    `used`: names by group, such as `tasks="coop_nav"`.
    """
    found = {f"{name} ({group})": code_of(group, name) for group, name in used.items()}
    return {f"code of {name}": code for name, code in found.items() if code is not None}


def _package_of(group: str, name: str) -> str | None:
    component = components(group).get(name)
    place = component if component is None or isinstance(component, str) else _place_of(component)
    return None if place is None else place.partition(":")[0].partition(".")[0]


def summary_of(component: Any) -> str:
    """Returns the first line of a component's docstring; of this package's, nothing is imported."""
    if not isinstance(component, str):
        return (inspect.getdoc(component) or "").partition("\n")[0]
    try:
        module = find_spec(component.partition(":")[0])
    except ModuleNotFoundError:  # nor is its package there
        module = None
    if module is None or module.origin is None:
        return ""
    tree = ast.parse(Path(module.origin).read_text(encoding="utf-8"))
    return (ast.get_docstring(tree) or "").partition("\n")[0]


@cache
def _installed(group: str) -> Mapping[str, str]:
    """The entry points of installed distributions, "module:Name" by name."""
    found: dict[str, str] = {}
    points = entry_points(group=f"swarmdata.{group}")  # in the order of the disk
    for point in sorted(points, key=lambda each: getattr(each.dist, "name", "")):
        where = f"uninstall {getattr(point.dist, 'name', 'the distribution')}, or rename it there"
        _check_free(group, point.name, where)
        if found.setdefault(point.name, point.value) != point.value:
            raise SpecError(
                f"two installed distributions have {point.name!r} among the entry points "
                f"swarmdata.{group}: {found[point.name]} and {point.value}; {where}"
            )
    return MappingProxyType(found)


def _check_free(group: str, name: str, advice: str) -> None:
    if name in _own_names.get(group, ()):
        raise SpecError(
            f"{name!r} among {group} is a component of swarmdata, which cannot be replaced; "
            f"{advice}"
        )


def _place_of(component: Any) -> str | None:
    """The "module:Name" by which other processes find a class, None if they cannot."""
    module, name = getattr(component, "__module__", ""), getattr(component, "__qualname__", "")
    if module in ("", "__main__") or "." in name:
        return None
    found = getattr(sys.modules.get(module), name, None)
    return f"{module}:{name}" if found is component else None
