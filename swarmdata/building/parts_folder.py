"""The folder of parts of an unfinished dataset; a part is a pure function of the recipe."""

import json
import re
import shutil
from dataclasses import dataclass
from pathlib import Path

from swarmdata.behavior_policies.checkpoint_files import own_checkpoints
from swarmdata.errors import BuildError, RecipeConflictError
from swarmdata.runtime.engines.jobs import Job
from swarmdata.runtime.locking import beside
from swarmdata.specs.frozen import differences
from swarmdata.specs.recipe import Recipe, who_acts
from swarmdata.store import remove_leftovers, write_file
from swarmdata.store.arrays.layout import CHECKPOINTS, RECIPE
from swarmdata.store.assembly import own_code
from swarmdata.store.episode_order import MergeOrder, merge_order
from swarmdata.store.parts import is_consumed, read_part_table
from swarmdata.store.table import PartTable, n_steps_of

SPACE_FACTOR = 1.1  # room that is asked for, by the size that is expected
_PART = re.compile(r"policy-\d+-part-\d{5,}")  # names of parts


def build_folder(out: Path) -> Path:
    """Where the parts of an unfinished dataset are."""
    whole = out.resolve()  # `.` has no name
    return beside(whole) / f"{whole.name}.build"


@dataclass(frozen=True)
class Parts:
    """The folder of parts of one recipe."""

    recipe: Recipe  # the recipe
    folder: Path  # of its parts, with a note of the recipe

    def open(self, checkpoints: Path | None) -> None:
        """Creates the folder, or checks that the one there is of the same recipe.

        The recipe's own networks are copied from a folder that has a folder `checkpoints`; None:
        they are here already, or there are none.
        """
        source = self.folder if checkpoints is None else checkpoints
        networks = own_checkpoints(self.recipe.policies, source)  # before the folder is made
        self.folder.mkdir(exist_ok=True)
        self._note()
        for path in self.all():
            if is_consumed(path):  # an interrupted assembly has taken files of it
                shutil.rmtree(path)
        for name, content in networks.items():
            (self.folder / CHECKPOINTS).mkdir(exist_ok=True)
            write_file(self.folder / CHECKPOINTS / name, content)

    def _note(self) -> None:
        """Writes the note of the recipe, or compares the one that is there."""
        self.remove_leftovers()
        code = own_code(self.recipe.spec, self.recipe.policies)
        if not self.note.exists():
            if any(path != self.code for path in self.folder.iterdir()):
                raise BuildError(
                    f"{self.folder} is not a folder of parts: it has other files and no {RECIPE}. "
                    "Parts of a build are collected there. Move it away, or choose another folder "
                    "for the dataset."
                )
            if code:
                write_file(self.code, json.dumps(code).encode())
            write_file(self.note, self.recipe.to_json().encode())
            return
        there = Recipe.from_file(self.note)
        if there != self.recipe:
            changes = "; ".join(
                f"{path} is {old!r} there, {new!r} in the recipe"
                for path, old, new in differences(there, self.recipe)
            )
            raise RecipeConflictError(
                f"{self.folder} holds parts of another recipe: {changes}. "
                "Choose another folder, or move it away."
            )
        made_by = json.loads(self.code.read_bytes()) if self.code.exists() else {}
        if changed := dict(made_by.items() ^ code.items()):
            raise RecipeConflictError(
                f"{self.folder} holds parts that were made before the {min(changed)} changed. "
                "Move it away to make them anew, or build in another folder."
            )

    @property
    def code(self) -> Path:
        """Digests of the code of users' tasks and policies that made the parts, if there is any."""
        return self.folder / "code.json"

    @property
    def note(self) -> Path:
        """The recipe that the parts are of, by which the folder is known."""
        return self.folder / RECIPE

    def is_ours(self) -> bool:
        """Whether the folder has been begun with this recipe."""
        try:
            return Recipe.from_file(self.note) == self.recipe
        except (OSError, ValueError):  # absent, or a file of the user's
            return False

    def remove_leftovers(self) -> None:
        remove_leftovers(self.folder, RECIPE, _PART)

    def remove_checkpoints(self) -> None:
        """Removes the copies of the recipe's networks, and their folder if it is empty then."""
        folder = self.folder / CHECKPOINTS
        if not folder.is_dir():
            return
        remove_leftovers(folder)
        for source in who_acts(self.recipe.policies):
            if source.checkpoint is not None:
                (folder / source.checkpoint).unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()

    def all(self) -> list[Path]:
        """Every part, those after a gap included."""
        return sorted(path for path in self.folder.iterdir() if _PART.fullmatch(path.name))

    def path(self, policy: int, part: int) -> Path:
        """Where a part is, or will be."""
        return self.folder / f"policy-{policy}-part-{part:05d}"

    def folders(self) -> dict[int, list[Path]]:
        """Consecutive finished parts of each policy, from part 0."""
        found: dict[int, list[Path]] = {}
        for policy in range(len(self.recipe.policies)):
            found[policy] = []
            while (path := self.path(policy, len(found[policy]))).exists():
                found[policy].append(path)
        return {policy: paths for policy, paths in found.items() if paths}

    def tables(self) -> list[list[PartTable]]:
        """Tables of the parts in `folders`, by policy."""
        folders = self.folders()
        return [
            [read_part_table(path) for path in folders.get(policy, [])]
            for policy in range(len(self.recipe.policies))
        ]

    def tables_of(self, policy: int) -> list[PartTable]:
        """Tables of all parts of a policy, those after a gap included."""
        prefix = f"policy-{policy}-"
        return [read_part_table(path) for path in self.all() if path.name.startswith(prefix)]

    def all_tables(self) -> list[PartTable]:
        """Tables of the parts in `folders`."""
        return [table for tables in self.tables() for table in tables]

    def merge(self) -> MergeOrder:
        """The order of episodes in the dataset, and which policy lacks some."""
        lengths = [[n for table in of for n in table["length"].tolist()] for of in self.tables()]
        return merge_order(self.recipe, lengths)

    def needed_steps(self, policy: int) -> float:
        """Joint steps that a policy has to give."""
        whole = sum(source.share for source in self.recipe.policies)
        return self.recipe.n_steps * self.recipe.policies[policy].share / whole

    def wave(self, merge: MergeOrder) -> list[Job]:
        """The parts to make next: what each policy's share still needs, by its mean part so far.

        A policy without parts gets one; after that the estimates are good, and hardly any part is
        made that the dataset does not need.
        """
        jobs = []
        for policy, tables in enumerate(self.tables()):
            steps = n_steps_of(*tables)
            left = self.needed_steps(policy) - steps
            mean = steps / len(tables) if tables else self.recipe.n_steps
            n_parts = max(int(policy == merge.lacking or not tables), round(left / mean))
            jobs += [self.job(policy, len(tables) + k) for k in range(n_parts)]
        return jobs

    def job(self, policy: int, part: int) -> Job:
        return Job(
            name=f"part {part} of {self.recipe.policies[policy].label}",
            payload={
                "recipe": self.recipe.to_json(),
                "policy": policy,
                "part": part,
                "folder": str(self.path(policy, part).resolve()),  # for processes elsewhere
            },
        )

    def has_room_for_copy(self) -> bool:
        """Whether the disk can hold the assembled dataset beside all parts."""
        needed = SPACE_FACTOR * self._step_bytes() * self.recipe.n_steps
        return shutil.disk_usage(self.folder).free >= needed

    def _step_bytes(self) -> float:
        """Bytes of a joint step in the parts that are there."""
        n_bytes = sum(file.stat().st_size for file in self.folder.glob("policy-*/*"))
        return n_bytes / n_steps_of(*self.all_tables())

    def check_space(self) -> None:
        """Raises if the disk cannot hold the missing parts, and then the assembled dataset.

        Parts are consumed where there is no room for a copy, but two of each policy are there until
        others are copied. Sizes are those of the parts that are there; before the first part
        nothing is known.
        """
        tables = self.all_tables()
        have = n_steps_of(*tables)
        if not have:
            return
        largest = max(map(n_steps_of, tables))
        spare = min(self.recipe.n_steps, 2 * len(self.recipe.policies) * largest)
        needed = self._step_bytes() * (max(0, self.recipe.n_steps - have) + spare)
        free = shutil.disk_usage(self.folder).free
        if free < needed:
            raise BuildError(
                f"{self.recipe.id} needs {needed / 1e6:.0f} MB more in {self.folder.parent}, which "
                f"has {free / 1e6:.0f} MB free. Make room or choose another folder; finished parts "
                "are kept."
            )
