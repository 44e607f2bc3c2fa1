from pathlib import Path

import pytest

from tests.strangers.sources import write_sources


@pytest.fixture(scope="package")
def sources(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A valid session, stack, result and dictionary; do not change them."""
    return write_sources(tmp_path_factory.mktemp("sources"))
