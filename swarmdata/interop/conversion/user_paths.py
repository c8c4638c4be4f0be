"""Paths as users write them, with `~` for a home folder."""

from pathlib import Path

from swarmdata.errors import ConversionError


def absolute_path(path: Path | str) -> Path:
    """Returns the absolute path that is meant; `~` is a home folder.

    Raises:
        ConversionError: it begins with `~NAME`, and there is no such user.
    """
    try:
        return Path(path).expanduser().absolute()
    except RuntimeError as error:  # pathlib's, for a user without a home folder
        user = Path(path).parts[0]
        raise ConversionError(
            f"{str(path)!r}: {user!r} is no home folder of this machine. Write the whole path, or "
            f"'./{user}' for a folder of that name."
        ) from error
