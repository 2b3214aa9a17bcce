"""Measure the string and its peers in one run, and write `results/bench.json`.

    python -m strandcast_studies.benchmarks.simulation.run [--quick] [--threads N] [--out FILE]

Costs are CPU seconds of the whole process per simulated second of one string, with wall times beside them.
Ratios use CPU times, so that other work on the machine cancels. Every peer is measured with a step at which
it is no more accurate than ours on the same strings (`comparison.equal_steps`).
"""

import argparse
import platform
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import llvmlite.binding as llvm
import numba
import numpy as np

from strandcast.dynamics.parameters import Array
from strandcast.threads import threads as use_threads
from strandcast_studies.benchmarks.simulation import accuracy, comparison, counting, ours, peak, startup
from strandcast_studies.benchmarks.simulation.comparison import PeerSetup
from strandcast_studies.benchmarks.simulation.entries import (
    OURS,
    Entry,
    of_spread,
    of_timing,
    report_progress,
    table,
    write,
)
from strandcast_studies.benchmarks.simulation.numpy_string import NumpyString
from strandcast_studies.benchmarks.simulation.swing import CAST, DURATION_S, SEGMENTS, SNAP, HandSwing, plain
from strandcast_studies.benchmarks.simulation.timing import Timing, timed


@dataclass(frozen=True)
class Effort:
    """The amount of work of a run."""

    draws: int = 400  # of Table 2, for our error
    common: int = 8  # strings for the peers
    independent: int = 3  # strings for the independent integrator
    batch: int = 4096  # strings per timed run of ours
    scalar_batch: int = 256  # the same of its scalar build
    repeats: int = 7  # timed runs of ours
    peer_repeats: int = 3  # timed runs of each peer
    turns: int = 20_000_000  # of the multiply-add loop per timed run
    coarse: bool = False  # only two steps and two strings per peer, and no first calls


QUICK = Effort(16, 2, 1, 64, 16, 2, 2, 2_000_000, coarse=True)


def peer_setups() -> Iterator[PeerSetup | Entry]:
    """Yield the installed peers; for a missing one, an entry that says so."""
    yield PeerSetup("numpy", NumpyString, (2.5e-4, 1e-4, 5e-5), 1e-5, 128)
    try:
        from strandcast_studies.benchmarks.simulation.mujoco_chain import HingeChain
        from strandcast_studies.benchmarks.simulation.mujoco_flex import DiscreteFlex, SpringFlex

        ladder = (2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
        yield PeerSetup("mujoco_hinge", HingeChain, ladder, 1e-3 / 32, 16, True)
        yield PeerSetup("mujoco_flex_springs", SpringFlex, ladder, 1e-3 / 32, 8, True)
        yield PeerSetup("mujoco_flex_discrete", DiscreteFlex, ladder[:4], 1e-3 / 32, 8, True)
    except ImportError as error:
        yield _left_out("mujoco", error)
    try:
        from strandcast_studies.benchmarks.simulation.pyelastica import CosseratRod

        yield PeerSetup("pyelastica", CosseratRod, (5e-4, 2.5e-4, 1.25e-4, 6.25e-5), 1.25e-5, 16)
    except ImportError as error:
        yield _left_out("pyelastica", error)


def _left_out(peer: str, error: ImportError) -> Entry:
    report_progress(f"{peer} is left out: it is not installed ({error}); `make bench` installs it")
    return Entry("left_out", f"not installed: {error}", "", peer)


def machine(threads: int) -> Iterator[Entry]:
    """Yield the processor, the threads and the versions."""
    yield Entry("threads", threads, "1")
    yield Entry("processor", f"{_processor()} ({llvm.get_host_cpu_name()})", "")
    yield Entry("version", platform.python_version(), "", "python")
    for package in ("strandcast", "numba", "llvmlite", "numpy", "mujoco-core", "pyelastica"):
        try:
            yield Entry("version", version(package), "", package)
        except PackageNotFoundError:
            continue


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def our_errors(effort: Effort) -> tuple[float, accuracy.Reference, list[Entry]]:
    """Return the step that meets the bound in f32, the strings of the main result, and our errors."""
    truth = accuracy.drawn_reference(CAST, effort.draws)
    by_step = accuracy.errors_by_step(ours.F32, CAST, truth)
    step = accuracy.coarsest_step(by_step)
    found = [
        Entry("dt_ms", 1e3 * step, "ms"),
        Entry("hand_fastest_m_s", CAST.fastest_m_s(), "m/s"),
        Entry("draws_regular", len(truth.parameters), f"of {truth.drawn}"),
    ]
    found += _percentiles("tip_error", by_step[step])
    found += _percentiles("tip_error_f64", accuracy.tip_errors_mm(ours.F64, CAST, truth, step))
    for dt_s, errors in by_step.items():
        found.append(Entry(f"tip_error_mm@{1e3 * dt_s:.3g}ms", float(np.median(errors)), "mm"))
    independent = accuracy.independent_mm(CAST, truth, effort.independent)
    found.append(_of_draws("reference_to_dop853_mm", independent))
    snap = accuracy.drawn_reference(SNAP, effort.draws)
    found.append(Entry("hand_fastest_m_s_snap", SNAP.fastest_m_s(), "m/s"))
    found.append(Entry("draws_regular_snap", len(snap.parameters), f"of {snap.drawn}"))
    found += _percentiles("tip_error_snap", accuracy.tip_errors_mm(ours.F32, SNAP, snap, step))
    return step, truth, found


def rate_reading(effort: Effort) -> Iterator[Entry]:
    """Yield the error and speed of the other reading, at the step that meets the bound there."""
    truth = accuracy.drawn_reference(CAST, effort.draws, ours.RATE_F64)
    by_step = accuracy.errors_by_step(ours.RATE_F32, CAST, truth)
    step = accuracy.coarsest_step(by_step)
    yield Entry("dt_ms_rate", 1e3 * step, "ms")
    yield from _percentiles("tip_error_rate", by_step[step])
    cost = our_cost(ours.RATE_F32, CAST, truth.parameters, step, effort.batch, effort.repeats)
    yield of_spread("string_seconds_per_s_rate", cost.wall.rate(), "1")


def _of_draws(name: str, errors_mm: Array) -> Entry:
    finite = errors_mm[np.isfinite(errors_mm)]
    return Entry(name, float(np.median(finite)), "mm", OURS, float(finite.min()), float(finite.max()))


def _percentiles(name: str, errors_mm: Array) -> list[Entry]:
    """Return entries of median, range and 95th percentile; lost strings count as infinite errors."""
    lost = float(np.mean(~np.isfinite(errors_mm)))
    p95 = float(np.percentile(errors_mm, 95, method="higher"))
    return [
        _of_draws(f"{name}_mm", errors_mm),
        Entry(f"{name}_p95_mm", p95 if np.isfinite(p95) else "infinite", "mm"),
        Entry(f"{name}_lost", lost, "1"),
    ]


def our_cost(
    mode: ours.Mode, swing: HandSwing, parameters: Array, step: float, batch: int, repeats: int
) -> Timing:
    """Time the evaluation of E per string-second, on a batch of the given strings."""
    many = np.resize(parameters, (batch, parameters.shape[1]))
    measured = ours.measured(swing, parameters[0])
    return timed(partial(ours.errors, mode, swing, many, step, measured), repeats).per(batch * DURATION_S)


def peaks(threads: int, turns: int, repeats: int) -> Iterator[tuple[int, Timing]]:
    """Yield bits and the time of one multiplication or addition: CPU time of one core, wall time of all."""
    for bits in (64, 32):
        loop = peak.compiled(bits)
        yield bits, timed(partial(loop.run, turns, threads), repeats).per(threads * loop.operations(turns))


def our_speed(
    effort: Effort, threads: int, truth: accuracy.Reference, step: float
) -> tuple[Timing, list[Entry]]:
    """Return our cost in f32, and the entries of our speed."""
    found: list[Entry] = []
    costs = {}
    for label, mode in {"": ours.F32, "_f64": ours.F64, "_scalar": ours.SCALAR}.items():
        batch = effort.scalar_batch if mode.scalar else effort.batch
        costs[label] = cost = our_cost(mode, CAST, truth.parameters, step, batch, effort.repeats)
        if mode.scalar:
            found += of_timing(cost, "numba_scalar")
            continue
        found.append(of_spread(f"string_seconds_per_s{label}", cost.wall.rate(), "1"))
        found.append(of_spread(f"string_seconds_per_cpu_s{label}", cost.cpu.rate(), "1"))
        found += of_timing(cost, OURS, label)
    for label in ("", "_f64"):
        for kind, suffix in (("cpu", ""), ("wall", "_wall")):
            faster = comparison.ratio(getattr(costs["_scalar"], kind), getattr(costs[label], kind))
            found.append(of_spread(f"ratio_numba_scalar{label}{suffix}", faster, "x", "numba_scalar"))
    points_per_string_s = SEGMENTS / step
    for bits, best in peaks(threads, effort.turns, effort.repeats):
        label = "" if bits == 32 else "_f64"
        operations = counting.step_operations(bits)
        least = operations * points_per_string_s
        found.append(Entry(f"operations_per_point_step{label}", operations, "1"))
        found.append(of_spread(f"peak_per_core{label}", best.cpu.rate().per(1e9), "1e9/s"))
        found.append(of_spread(f"peak_all_cores{label}", best.wall.rate().per(1e9), "1e9/s"))
        for kind, suffix in (("cpu", ""), ("wall", "_wall")):
            share = comparison.ratio(getattr(best, kind), getattr(costs[label], kind)).per(1.0 / least)
            found.append(of_spread(f"peak_fraction{label}{suffix}", share, "1"))
    return costs[""], found


def against(
    effort: Effort, threads: int, truth: accuracy.Reference, step: float, own: Timing
) -> Iterator[Entry]:
    """Measure all peers on the same strings."""
    candidates = accuracy.reference(CAST, plain(truth.parameters[: 4 * effort.common]))
    few = slice(effort.common)
    common = replace(candidates, parameters=candidates.parameters[few], positions=candidates.positions[few])
    ours_mm = accuracy.tip_errors_mm(ours.F32, CAST, common, step)
    yield _of_draws("tip_error_common_mm", ours_mm)
    flexes = []
    for setup in peer_setups():
        if isinstance(setup, Entry):
            yield setup
            continue
        report_progress(f"{setup.name} …")
        if effort.coarse:
            ladder_s = setup.ladder_s[:2]
            setup = replace(setup, ladder_s=ladder_s, tiny_s=ladder_s[-1] / 2, batch=2)
        ladder = comparison.climb(setup, CAST, common.parameters, threads, effort.peer_repeats)
        found = list(comparison.entries(ladder, ours_mm, own))
        flexes += [entry for entry in found if entry.name == f"ratio_{setup.name}" and "_flex_" in entry.name]
        yield from found
    if flexes:
        yield replace(min(flexes, key=lambda entry: entry.value), name="ratio_mujoco_flex")


def measure(effort: Effort, threads: int) -> list[Entry]:
    """Measure everything."""
    found = list(machine(threads))
    report_progress("our error …")
    step, truth, errors = our_errors(effort)
    report_progress("our speed …")
    own, speed = our_speed(effort, threads, truth, step)
    found += errors + speed
    found += rate_reading(effort)
    found += against(effort, threads, truth, step, own)
    if not effort.coarse:
        report_progress("first calls …")
        found += startup.entries(2)
    return found


def main(arguments: list[str] | None = None) -> None:
    """Run the benchmark from the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__))
    parser.add_argument("--quick", action="store_true", help="a few strings and coarse steps, as a test run")
    parser.add_argument("--threads", type=int, default=numba.config.NUMBA_NUM_THREADS)
    parser.add_argument("--out", type=Path, default=Path("results/bench.json"))
    chosen = parser.parse_args(arguments)
    threads = min(chosen.threads, numba.config.NUMBA_NUM_THREADS)
    with use_threads(threads):
        found = measure(QUICK if chosen.quick else Effort(), threads)
    write(chosen.out, found)
    print(table(found))
    print(f"\nwritten: {chosen.out}")


if __name__ == "__main__":
    main()
