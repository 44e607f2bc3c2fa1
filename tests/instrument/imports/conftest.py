"""A folder that several tests import."""

from pathlib import Path

import pytest

from tests.instrument.imports.folders import TIMES, mosaic, write_dng


@pytest.fixture
def brackets(tmp_path: Path) -> Path:
    """Three poses of two exposures as DNG, in the order in which they were taken."""
    for i in range(6):
        write_dng(tmp_path / f"IMG_{i + 8}.dng", mosaic(i), TIMES[i % 2])
    return tmp_path
