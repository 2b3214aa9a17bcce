"""Operation counts, peak rate, comparison of ladders, timing and entries."""

import json
from dataclasses import fields

import llvmlite.binding as llvm
import numpy as np
import pytest

from strandcast.dynamics import elements, simd
from strandcast_studies.benchmarks.simulation import accuracy, counting, peak
from strandcast_studies.benchmarks.simulation.comparison import (
    Ladder,
    PeerSetup,
    cheapest_steps,
    cost_at,
    equal_steps,
    ratio,
)
from strandcast_studies.benchmarks.simulation.counting import Counted
from strandcast_studies.benchmarks.simulation.entries import Entry, table, write
from strandcast_studies.benchmarks.simulation.swing import COMMON_S, every, rms_mm, stays_regular
from strandcast_studies.benchmarks.simulation.timing import Spread, Timing, timed


def test_numbers_count_their_operations():
    a, b = Counted(3.0), Counted(4.0)
    Counted.operations = 0
    result = -(a * b + 1.0) / (2.0 - a) * 0.5
    assert (result.value, Counted.operations) == (6.5, 5)
    assert a < b
    assert Counted.operations == 5


def test_kernels_are_replaced_by_their_source_and_restored():
    compiled = elements.segment
    with counting.interpreted():
        Counted.operations = 0
        ux, uy, length, inverse = elements.segment(None, Counted(3e-2), Counted(4e-2))
        # Two squares, their sum, an inverse root of two, and three products.
        assert Counted.operations == 3 + 2 + 3
    values = [number.value for number in (ux, uy, length, inverse)]
    assert values == pytest.approx([0.6, 0.8, 5e-2, 20.0])
    assert elements.segment is compiled
    assert elements.load is simd.load


def test_a_step_costs_the_same_per_point_of_any_string():
    short, long = (counting.step_operations(64, n) for n in (20, 60))
    assert 200 < short < 500
    assert long == pytest.approx(short, rel=0.02)
    assert counting.step_operations(32, 20) < short


@pytest.mark.parametrize("bits", [64, 32])
def test_peak_runs_on_fused_multiply_adds_in_registers(bits):
    loop = peak.compiled(bits)
    turns = 1000
    # Each chain converges to 2, the fixed point of a -> a / 2 + 1; the first lane adds them up.
    assert loop.run(turns, 2) == pytest.approx([0.5 + 2.0 * peak.CHAINS] * 2)
    if llvm.get_host_cpu_features().get("fma"):
        assert loop.assembly.count("vfmadd") == peak.CHAINS
    assert loop.operations(1) == 2 * peak.CHAINS * peak.register_bits() / bits


def ladder(errors, costs):
    setup = PeerSetup("peer", None, tuple(range(len(costs))), 0.0, 1)
    timings = tuple(Timing(Spread(c, 0.9 * c, 1.1 * c), Spread(c, c, c)) for c in costs)
    return Ladder(setup, np.array(errors, dtype=float), timings)


def test_a_peers_step_is_no_more_accurate_than_ours():
    # The peer is more accurate: never, at the finest step, always, until it diverges; or always diverges.
    errors = [[5, 4, 0.01, 99, 99], [2, 1, 0.001, 0.01, 99], [1, 0.05, 0.001, 0.001, 99]]
    measured = ladder(errors, [1.0, 2.0, 4.0])
    ours_mm = np.full(5, 0.1)
    assert equal_steps(measured, ours_mm).tolist() == [2, 1, 0, 1, 2]
    assert cheapest_steps(measured).tolist() == [0, 0, 0, 1, 2]
    assert cost_at(measured, equal_steps(measured, ours_mm)).cpu == Spread(2.0, 1.8, 2.2)
    assert ratio(Spread(8, 6, 9), Spread(2, 1, 3)) == Spread(4, 2, 9)


def test_the_coarsest_step_within_the_bound_is_chosen():
    errors = {2e-3: 0.05, 1e-3: 0.3, 5e-4: 0.08, 2.5e-4: 0.01}
    by_step = {dt_s: np.array([0.0, error, 9.0]) for dt_s, error in errors.items()}
    assert accuracy.coarsest_step(by_step) == 5e-4


def test_lost_tips_have_infinite_errors():
    truth = np.zeros((2, 4, 2))
    tips = truth + np.array([[[3e-3, 4e-3]], [[np.nan, 0.0]]])
    assert rms_mm(tips, truth).tolist() == pytest.approx([5.0, np.inf])


def test_regular_strings_keep_their_segments_within_bounds():
    straight = np.zeros((3, 2, 21, 2))
    straight[..., 0] = np.linspace(0.0, 0.5, 21)
    straight[1, 1, 20, 0] += 0.06
    straight[2, 0, 20, 0] -= 0.02
    assert stays_regular(straight).tolist() == [True, False, False]


def test_steps_must_divide_the_common_times():
    assert every(1e-3) == 2
    assert COMMON_S[0] == 2e-3
    with pytest.raises(ValueError, match="does not divide"):
        every(1.5e-3)


def test_timing_excludes_the_first_run():
    runs = []

    def work():
        runs.append(1)
        return runs

    timing = timed(work, 3)
    assert len(runs) == 4
    assert timing.cpu.least <= timing.cpu.value <= timing.cpu.greatest
    with pytest.raises(AssertionError):
        timed(lambda: None, 1)


def test_entries_are_a_list_of_records(tmp_path):
    entries = [Entry("a", 1.5, "mm", "numpy", 1.0, 2.0), Entry("version", "1.0", "")]
    write(tmp_path / "bench.json", entries)
    read = json.loads((tmp_path / "bench.json").read_text())
    assert [list(entry) for entry in read] == [[field.name for field in fields(Entry)]] * 2
    assert read[0] == {"name": "a", "value": 1.5, "unit": "mm", "peer": "numpy", "min": 1.0, "max": 2.0}
    assert table(entries).splitlines()[1].split() == ["a", "1.5", "1", "2", "mm", "numpy"]
    with pytest.raises(ValueError, match="JSON"):
        write(tmp_path / "bench.json", [Entry("a", float("nan"), "mm")])
