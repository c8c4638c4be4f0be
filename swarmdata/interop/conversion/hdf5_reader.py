"""HDF5 files of others, opened so that they give nothing but numbers of their own.

A file may name other files of this machine as content, which an import would then publish.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from swarmdata.errors import ConversionError
from swarmdata.interop.conversion.foreign_file import check_stored, reading

MOST_CHUNK_BYTES = 256 << 20  # of a chunk in memory, which is unpacked as a whole


@contextmanager
def open_hdf5(path: Path) -> Iterator[Any]:
    """Opens a file that neither refers to other files nor declares more than it stores."""
    import h5py  # noqa: PLC0415  (heavy)

    with reading(path, "It is damaged, or not an HDF5 file."):
        file = h5py.File(path, "r")
    with file:
        with reading(path, "It is damaged."):
            _check_content(file, path)
        yield file


def _check_content(file: Any, path: Path) -> None:
    """Looks at every link and array, each once: hard links may form circles."""
    import h5py  # noqa: PLC0415  (heavy)

    seen, groups = set(), [("", file)]
    while groups:
        prefix, group = groups.pop()
        for name in group:
            place = f"{path}: {prefix}{name}"
            link = group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise ConversionError(
                    f"{place} is a {type(link).__name__} to {link.path!r}, expected an array or a "
                    "group: links may lead to other files. Copy the data into the file."
                )
            found = group[name]
            address = h5py.h5o.get_info(found.id).addr
            if address in seen:
                continue
            seen.add(address)
            if isinstance(found, h5py.Group):
                groups.append((f"{prefix}{name}/", found))
            elif isinstance(found, h5py.Dataset):
                _check_array(found, place)


def _check_array(array: Any, place: str) -> None:
    if array.external or array.is_virtual:
        raise ConversionError(
            f"{place} has its content in other files, expected it here: an import would copy any "
            "file of this machine. Copy the data into the file."
        )
    if array.shape is None:
        raise ConversionError(f"{place} is empty: it has no shape")
    size = array.dtype.itemsize
    check_stored(place, array.size * size, array.id.get_storage_size())
    chunk = size * math.prod(array.chunks or ())
    if chunk > MOST_CHUNK_BYTES:
        raise ConversionError(
            f"{place} has chunks of {chunk / 1e6:,.0f} MB, expected at most "
            f"{MOST_CHUNK_BYTES / 1e6:,.0f} MB. Write it with smaller chunks."
        )


def numbers(file: Any, key: str, source: Path) -> Any:
    """The array `key` of a file; ConversionError unless it holds rows of numbers."""
    found = file.get(key)
    dtype = getattr(found, "dtype", None)
    if dtype is None or dtype.kind not in "biuf" or not found.shape:
        kind = "nothing" if found is None else f"{type(found).__name__} of type {dtype}"
        raise ConversionError(f"{source} has {kind} at {key!r}, expected rows of numbers")
    return found
