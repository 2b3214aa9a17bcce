"""Two sets of results side by side: pairs, differences with their uncertainty, and the page."""

import math
from dataclasses import replace
from pathlib import Path

import pytest

from strandcast.core.trial_names import trial_name
from strandcast.errors import StrandcastError
from strandcast.report.comparison import (
    Row,
    Tally,
    TrialRecords,
    Value,
    compare,
    parameters_of,
    read_records,
    sign_test,
)
from strandcast.report.comparison_page import change, comparison_lines, comparison_page, headline


def trials(
    results: Path, numbers: tuple[int, ...] = (1, 2, 3), seconds: float = 10.0
) -> dict[int, TrialRecords]:
    return {k: TrialRecords(read_records(results / trial_name(k)), {"track": seconds}) for k in numbers}


def changed(trial: TrialRecords, record: str, **values: object) -> TrialRecords:
    records = dict(trial.records)
    records[record] = records[record].model_copy(update=values)
    return TrialRecords(records, trial.times_s)


def test_a_difference_has_the_deviation_of_both() -> None:
    assert Value(5.0, 0.3).less(Value(3.0, 0.4)) == Value(2.0, pytest.approx(0.5))
    assert Value(5.0, 0.3).less(Value(3.0)) == Value(2.0, None)
    assert Value().less(Value(3.0, 0.4)) == Value()


@pytest.mark.parametrize(
    ("lower", "higher", "p"), [(0, 0, 1.0), (1, 0, 1.0), (5, 0, 2 / 32), (4, 1, 2 * 6 / 32), (3, 3, 1.0)]
)
def test_the_sign_test_counts_signs(lower: int, higher: int, p: float) -> None:
    assert sign_test(lower, higher) == pytest.approx(p)


def test_trials_are_paired_by_number(results: Path) -> None:
    a, b = trials(results, (1, 2)), trials(results, (2, 3), seconds=7.0)
    b[2] = changed(b[2], "verdict", miss_m=0.011, miss_sigma_m=0.003)
    a[2] = changed(a[2], "verdict", miss_m=0.015, miss_sigma_m=0.004)
    found = compare(("old", "new"), a, b)
    assert (found.trials, found.unpaired) == ([2], ([1], [3]))
    rows = {row.quantity: row for row in found.rows}
    assert rows["miss"].difference == Value(pytest.approx(-0.004), pytest.approx(0.005))
    assert rows["E after the fit"].difference == Value(0.0, None)
    assert rows["wall time"].difference.value == -3.0
    assert found.same_recording == {2: True}
    assert found.tallies == [Tally("miss", 1, 0, 1.0), Tally("wall time", 1, 0, 1.0)]


def test_equal_results_do_not_differ(results: Path) -> None:
    same = compare(("old", "new"), trials(results, (1,)), trials(results, (1,)))
    assert headline(same) == "No quantity that is counted differs."
    assert headline(replace(same, rows=[])) == "No quantity is known in both."


def test_results_without_a_common_trial_are_refused(results: Path) -> None:
    with pytest.raises(StrandcastError, match="old has 1; new has 2, 3") as caught:
        compare(("old", "new"), trials(results, (1,)), trials(results, (2, 3)))
    assert caught.value.code == "SC-W022"


def test_parameters_are_compared_in_decades(results: Path) -> None:
    trial = trials(results, (1,))[1]
    estimate = trial.records["estimate"]
    fit = estimate.parameters[0]
    ten_times = [fit.model_copy(update={"value": 10.0 * fit.value}), *estimate.parameters[1:]]
    other = changed(trial, "estimate", parameters=ten_times, dt_s=0.5, seed=estimate.seed)
    assert parameters_of(trial)[fit.name][1].value == pytest.approx(math.log10(fit.value))
    found = compare(("old", "new"), {1: trial}, {1: other})
    (row,) = [row for row in found.rows if row.quantity == fit.name]
    assert row.difference.value == pytest.approx(1.0)
    assert found.settings == [("dt_s", str(estimate.dt_s), "0.5")]


def test_a_difference_beyond_its_uncertainty_is_marked() -> None:
    clear = Row(1, "miss", "m", Value(0.010, 0.001), Value(0.015, 0.001))
    vague = Row(1, "miss", "m", Value(0.010, 0.010), Value(0.015, 0.010))
    assert change(clear) == "+5.00\u00a0±\u00a01.41\u00a0mm *"
    assert change(vague) == "+5.00\u00a0±\u00a014.14\u00a0mm"


def test_the_page_is_one_file_with_the_policy_of_the_others(results: Path) -> None:
    a, b = trials(results, (1, 2)), trials(results, (2, 3))
    b[2] = changed(b[2], "verdict", miss_m=0.011, miss_sigma_m=None)
    hostile = "<script>alert(1)</script>"
    page = comparison_page(compare((hostile, "new"), a, b))
    assert "default-src 'none'" in page
    assert "<script" not in page
    assert "&lt;script&gt;alert(1)" in page
    assert "prefers-color-scheme: dark" in page
    assert "@media print" in page
    assert "This figure could not be made" not in page
    assert "<td>k<sub>s</sub></td><td>log₁₀ N/(m·kg)</td>" in page
    assert "http://" not in page.replace("http://www.w3.org", "")
    assert comparison_page(compare((hostile, "new"), a, b)) == page


def test_lines_for_a_terminal_hold_the_same_numbers(results: Path) -> None:
    a, b = trials(results, (1, 2)), trials(results, (2, 3))
    lines = comparison_lines(compare(("old", "new"), a, b))
    assert lines[:2] == ["A: old", "B: new"]
    assert "only in old: trial 1" in lines
    miss = next(line for line in lines if line.startswith("2") and " miss " in line)
    assert "0.00" in miss
