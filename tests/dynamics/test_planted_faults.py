"""The proofs can fail: they catch faults that are planted in a copy of the simulator."""

import pytest
from planted_faults import FAULTS, Fault, catches, errors_with, faulty

BY_NAME = {each.name: each for each in FAULTS}


# Each copy is compiled again, most of a minute: one fault here, all of them by ``planted_faults.py``.
@pytest.mark.thorough
def test_fault_is_caught():
    found = errors_with(BY_NAME["first kick a full step"], ["dop853", "fall_through_air", "hangs_stretched"])
    assert catches("dop853", found["dop853"])
    assert catches("fall_through_air", found["fall_through_air"])
    assert not catches("hangs_stretched", found["hangs_stretched"])  # the copy does run


def test_every_fault_still_fits_the_code():
    for each in FAULTS:
        faulty(each)


def test_fault_that_no_longer_fits_is_refused():
    gone = Fault("gone", "hand.py", "no such text", "")
    with pytest.raises(LookupError, match="no longer contains 'no such text'"):
        faulty(gone)
