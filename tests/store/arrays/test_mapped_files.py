"""Files that cannot be mapped are named."""

import errno
import mmap
import re
from pathlib import Path
from unittest.mock import Mock

import pytest

from swarmdata.store import open_store
from swarmdata.store.arrays import mapped_files


@pytest.mark.slow
def test_too_few_addresses_are_one_sentence(tiny: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Under `ulimit -v`, mmap fails without a path and without a reason."""
    refuse = Mock(side_effect=OSError(errno.ENOMEM, "Cannot allocate memory"))
    monkeypatch.setattr(mapped_files, "mmap", Mock(mmap=refuse, ACCESS_READ=mmap.ACCESS_READ))
    named = re.escape(str(tiny / "data.zarr"))
    with pytest.raises(OSError, match=rf"cannot be mapped.*`ulimit -v unlimited`.*{named}"):
        open_store(tiny)
