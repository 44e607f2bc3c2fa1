"""What every device of a kind keeps: test classes for the drivers here, for others, and for the bench."""

import pytest

# An assertion that fails shows its values, as in a file of tests.
pytest.register_assert_rewrite("drivers.contracts.camera", "drivers.contracts.light", "drivers.contracts.stage")
