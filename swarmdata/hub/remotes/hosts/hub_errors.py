"""The many errors of huggingface_hub, turned into ours.

Written for versions 0.34 to 2.x, whose HTTP libraries differ (requests, httpx, httpx2): errors are
told apart by the answer's status and by the library that they come from.
"""

import errno
import json
import re
from typing import Any

from swarmdata.errors import AbsentFileError, ConflictError, HubError, quoted
from swarmdata.hub.remotes.network.backoff import LOCAL_ERRNOS, TransientError, seconds

HTTP_LIBRARIES = ("requests", "urllib3", "httpx", "httpx2", "httpcore", "httpcore2", "hf_xet")
"""Whose errors are failures of the network, or of the server behind it."""

NAME_ERRNOS = (errno.ENAMETOOLONG, errno.ENOENT, errno.ENOTDIR, errno.EINVAL)
"""What a system says of a file's name that leads nowhere."""


def explained(error: Exception, what: str) -> Exception | None:
    """Translates an error of the client; None where it is no failure of a remote.

    Args:
        error: of the client.
        what: was done, for the message.
    """
    status = status_of(error)
    if status is not None:
        return _of_status(error, status, what)
    if isinstance(error, OSError) and error.errno in NAME_ERRNOS and _is_partial(error.filename):
        return HubError(
            f"{what} failed: the server's ETag cannot be part of a file's name, as the client has "
            "it. Tell whoever runs it, or pull from another remote."
        )
    if isinstance(error, OSError) and (error.filename is not None or error.errno in LOCAL_ERRNOS):
        return None
    problem = _words(error)
    network = OSError | RuntimeError | json.JSONDecodeError  # hf_xet raises RuntimeError
    if isinstance(error, network) or type(error).__module__.partition(".")[0] in HTTP_LIBRARIES:
        return TransientError(problem)
    if isinstance(error, ValueError):  # of names, and of the card's front matter
        return HubError(f"{what} failed: {problem}")
    return None


def _is_partial(file: object) -> bool:
    """Whether this is one of the client's partial files, whose names have the server's ETag."""
    return str(file).endswith(".incomplete")


def _of_status(error: Exception, status: int, what: str) -> Exception:
    from huggingface_hub.errors import EntryNotFoundError  # noqa: PLC0415

    if status in (408, 425, 429) or status >= 500:
        return TransientError(f"HTTP {status}", seconds(_header(error, "Retry-After")))
    if isinstance(error, EntryNotFoundError):
        return AbsentFileError(f"{what} failed: the repository has no such file.")
    problem = _words(error)
    if status == 412:
        return ConflictError(
            f"{what} failed: someone else has pushed there since. Nothing of this push is visible. "
            "Pull what is there, compare, and push again."
        )
    if status in (401, 403):
        return HubError(
            f"{what} failed, HTTP {status}: this token may not do that, or there is none. Log in "
            f"with `hf auth login`, or set HF_TOKEN. The Hub says: {problem}"
        )
    return HubError(f"{what} failed, HTTP {status}: {problem}")


def _response(error: BaseException) -> Any:
    """The HTTP answer behind an error, or behind what it was raised from."""
    at: BaseException | None = error
    for _ in range(10):  # causes of causes, which are not many
        if at is None:
            break
        response = getattr(at, "response", None)
        if response is not None:
            return response
        at = at.__cause__
    return None


def status_of(error: BaseException) -> int | None:
    """The HTTP status of the answer behind an error, None if there was no answer."""
    return getattr(_response(error), "status_code", None)


def _header(error: BaseException, name: str) -> str | None:
    value = getattr(_response(error), "headers", {}).get(name)
    return None if value is None else str(value)


def _words(error: BaseException) -> str:
    """An error and its cause in one line, without tokens."""
    text = f"{type(error).__name__}: {error}".rstrip(". \n")
    cause = error.__cause__
    if cause is not None and str(cause) not in text:
        text += f" ({type(cause).__name__}: {cause})"
    return quoted(scrub(text))


def scrub(text: str) -> str:
    """Removes tokens from a message of the client."""
    from huggingface_hub import get_token  # noqa: PLC0415

    token = get_token()
    hidden = text.replace(token, "***") if token else text
    return re.sub(r"\bhf_[A-Za-z0-9]{8,}", "hf_***", hidden)
