from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest

from analysis.reconstruction.options import ACCURACIES, Accuracy, Options
from instrument.files.validation import InvalidInputError


def test_a_word_that_is_not_allowed_is_refused_with_the_one_that_was_meant():
    with pytest.raises(InvalidInputError, match=r"parallax.*is 'On'; must be one of 'auto', 'on', 'off'.*'on'\?"):
        Options(parallax="On")  # type: ignore[arg-type]


def test_all_that_is_wrong_is_told_at_once():
    wrong: dict[str, Any] = {
        "accuracy": "high",
        "light": "nowhere",
        "palette": True,
        "power": "",
        "field": None,
        "dictionary": 3,
        "independent": "yes",
        "tolerance": float("nan"),
        "seed": -1,
        "threads": 0,
    }
    with pytest.raises(InvalidInputError) as caught:
        Options(**wrong)
    assert [problem.where for problem in caught.value.problems] == [
        "accuracy", "light", "palette", "power", "field", "dictionary", "independent", "tolerance", "seed", "threads",
    ]  # fmt: skip


@pytest.mark.parametrize("value", [2.5, "2", float("inf"), True])
def test_a_seed_is_a_whole_number(value: Any):
    with pytest.raises(InvalidInputError, match="seed"):
        Options(seed=value)


def test_numbers_of_numpy_are_numbers():
    options = Options(seed=np.int64(3), threads=np.int32(2), tolerance=np.float32(1.5))
    assert (options.seed, options.threads, options.tolerance) == (3, 2, 1.5)


def test_every_accuracy_has_a_number_of_updates():
    assert set(get_args(Accuracy)) == set(ACCURACIES)
