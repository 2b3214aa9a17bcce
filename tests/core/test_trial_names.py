"""The names of trials: one for each number, and their order."""

import re

import pytest

from strandcast.core.trial_names import TRIAL_DIGITS, in_trial_order, trial_digits, trial_name, trial_number


@pytest.mark.parametrize(
    ("number", "name"),
    [
        (1, "trial-01"),
        (10, "trial-10"),
        (99, "trial-99"),
        (100, "trial-100"),
        (101, "trial-101"),
        (12345, "trial-12345"),
        (999_999, "trial-999999"),
    ],
)
def test_a_number_has_one_name(number, name):
    assert trial_name(number) == name
    assert trial_number(name) == number
    assert re.fullmatch(TRIAL_DIGITS, trial_digits(number))


@pytest.mark.parametrize(
    "digits", ["", "0", "1", "00", "001", "007", "0100", "1000000", "٠١", "01 ", "01\n", "1e3"]
)
def test_other_digits_name_no_trial(digits):
    assert trial_number(f"trial-{digits}") == 0
    assert not re.fullmatch(TRIAL_DIGITS, digits)


def test_paths_of_trials_are_in_the_order_of_their_numbers():
    numbers = (1, 2, 10, 99, 100, 101, 1000)
    ordered = [
        "results/x/cameras/main.json",
        *(f"results/x/{trial_name(number)}/track.json" for number in numbers),
        "results/x/zoo.json",
    ]
    assert sorted(ordered) != ordered
    assert in_trial_order(sorted(ordered)) == ordered
