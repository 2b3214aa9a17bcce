"""Held-out errors by how many recordings are fitted, which must not rise with them.

    python -m strandcast_studies.evidence.counts --cables black_weighted --counts 1-8 --seeds 1-2

The cables of `pac_cable` are held at one end: both motions of each are cut into recordings, the last of each
motion held out; of `deform_dlo`, held at both ends, training sequences are fitted, and the evaluation
sequences predicted. A seed gives the order of the recordings and the draws of the search.
"""

import argparse
import json
import os
from collections.abc import Collection, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from strandcast.config.estimate import EstimateSettings
from strandcast.dynamics.model import StringModel
from strandcast.dynamics.parameters import Array
from strandcast.estimation.cable_series import CableSeries
from strandcast.estimation.cable_space import CableSpace, space_of_cable
from strandcast.estimation.estimate import find_string
from strandcast.estimation.optimisers.optimiser import SearchStart
from strandcast.estimation.windows import parts_by_roll
from strandcast_studies.benchmarks.loop.run import numbers
from strandcast_studies.evidence import deform_dlo
from strandcast_studies.evidence.captured_weights import Recording, recorded, series_of
from strandcast_studies.evidence.figure import Figure
from strandcast_studies.evidence.pac_cable import CABLES, DRIVEN, FREE, known_of

Series = dict[str, CableSeries]  # a recording by the roll that its ends may have
COUNTS, SEEDS = tuple(range(1, 9)), (1, 2)
PIECES = 5  # of each motion of `pac_cable`
SETTINGS = EstimateSettings().in_space(thrown=False)
AT_MIDDLE_AND_END = np.array([0.5, 1.0])


class Recorded(NamedTuple):
    """What is fitted and predicted of one cable; `unknowns`: its model and what is fitted."""

    name: str
    unknowns: tuple[StringModel, CableSpace]
    fitted: list[Series]
    held_out: list[Series]


def by_count(cable: Recorded, counts: Sequence[int], seed: int) -> list[Figure]:
    """Return the mean error of held-out recordings by how many are fitted."""
    model, space = cable.unknowns
    order, figures = np.random.default_rng(seed).permutation(len(cable.fitted)), []
    for count in counts:
        parts = parts_by_roll([cable.fitted[k] for k in order[:count]], model.points, last=False)
        random, start = partial(np.random.default_rng, seed), SearchStart(None, count)
        found = find_string(parts, model, space, SETTINGS, random, start)
        own = [each[found.roll] for each in cable.held_out]
        errors_m = [_error_m(each, each.predicted(model, found.string)) for each in own]
        detail = {
            "standard_error_mm": 1e3 * float(np.std(errors_m, ddof=1) / np.sqrt(len(errors_m))),
            "fit_mm": 1e3 * found.log.best()[1],
            "held_out": len(errors_m),
        }
        note = "mean distance of the markers in recordings that were not fitted"
        about, error_mm = f"{cable.name}.seed_{seed}.of_{count}", 1e3 * float(np.mean(errors_m))
        figures.append(Figure(about, error_mm, "mm", None, note, detail))
    return figures


def _error_m(series: CableSeries, predicted_m: Array) -> float:
    return float(np.nanmean(np.linalg.norm(predicted_m - series.vertices_m, axis=2)))


def single_ended(folder: Path, cable: str) -> Recorded:
    """Return one cable of ``pac_cable``."""
    length_m = known_of(folder, cable)["L"]
    pieces = [_pieces(recorded(folder, kind, cable)) for kind in (FREE, DRIVEN)]
    fitted = [piece for motion in pieces for piece in motion[:-1]]
    unknowns = space_of_cable(length_m, False, weight_places_m=[length_m])
    return Recorded(f"pac_cable.by_count.{cable}", unknowns, fitted, [motion[-1] for motion in pieces])


def _pieces(recording: Recording) -> list[Series]:
    time_s, hand_m, down, markers_m = recording
    return [
        series_of(time_s[own], hand_m[own], down[own], markers_m[own], AT_MIDDLE_AND_END)
        for own in np.array_split(np.arange(len(time_s)), PIECES)
    ]


def two_ended(folder: Path, cable: str) -> Recorded:
    """Return one cable of ``deform_dlo``."""
    arrays = [np.load(folder / f"{cable}_{part}.npy").astype(float) for part in ("train", "eval")]
    places, length_m = deform_dlo.places_of(arrays[0])
    fitted, held_out = ([deform_dlo.series_of(each, places) for each in some] for some in arrays)
    return Recorded(f"deform_dlo.by_count.{cable}", space_of_cable(length_m, True), fitted, held_out)


def measure(
    folder: Path,
    cables: Collection[str] | None = None,
    counts: Sequence[int] = COUNTS,
    seeds: Sequence[int] = SEEDS,
) -> list[Figure]:
    """Return the figures of the cables, or of some, of a folder, ``pac_cable`` or ``deform_dlo``."""
    of = {cable: two_ended for cable in deform_dlo.cables_in(folder)} or dict.fromkeys(CABLES, single_ended)
    wanted = [cable for cable in of if cables is None or cable in cables]
    return [
        each
        for cable in wanted
        for seed in seeds
        for each in by_count(of[cable](folder, cable), counts, seed)
    ]


def main(arguments: list[str] | None = None) -> None:
    """Print the figures of some cables; the data are in the folder STRANDCAST_REAL_DATA."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cables", nargs="+", required=True)
    parser.add_argument("--counts", type=numbers, default=COUNTS)
    parser.add_argument("--seeds", type=numbers, default=SEEDS)
    given, data = parser.parse_args(arguments), Path(os.environ["STRANDCAST_REAL_DATA"])
    for folder in ("pac_cable", "deform_dlo"):
        for figure in measure(data / folder, given.cables, given.counts, given.seeds):
            print(json.dumps(figure.record()))


if __name__ == "__main__":
    main()
