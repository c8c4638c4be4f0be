"""Loads the tiny dataset as any program would, and notes each build."""

import os
import time
from pathlib import Path

import pytest

import swarmdata
from swarmdata.building import build as build_module
from swarmdata.hub.catalog import request
from swarmdata.specs.recipe import Recipe
from swarmdata.store import Manifest
from tests.support.one_process import use_one_process
from tests.support.tiny import TINY


def load_tiny(notes: str, *hold: str) -> None:
    """Every process that begins a build appends its id to a file; with `hold` it waits then."""
    make = build_module._make

    def noted(recipe: Recipe, *arguments: object) -> Manifest:
        with Path(notes).open("a") as file:
            file.write(f"{os.getpid()}\n")
        while hold:
            time.sleep(0.05)
        return make(recipe, *arguments)  # type: ignore[arg-type]

    patch = pytest.MonkeyPatch()
    use_one_process(patch)
    patch.setattr(build_module, "_make", noted)
    patch.setattr(request, "find_recipe", lambda name: TINY)
    dataset = swarmdata.load("coop_nav-tiny")
    print(dataset.digest, dataset.source)
