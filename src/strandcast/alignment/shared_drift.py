"""One drift for all trials of an experiment: a short throw hardly determines it, several do.

``python -m strandcast.alignment.shared_drift results/<experiment>`` prints it, and the settings that use it.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from strandcast.errors import StrandcastError
from strandcast.records.alignment import Alignment
from strandcast.records.folders import trial_folders

LEAST_INFORMATION = 1e-3  # of the prior's; trials with less are ignored
ODD = 4.0  # standard deviations from the shared drift


@dataclass(frozen=True)
class SharedDrift:
    """The drift that trials share, its standard error, and the trials that contradict it."""

    drift: float
    se: float
    odd: tuple[int, ...]


def shared_drift(alignments: Sequence[Alignment]) -> SharedDrift:
    """Return the drift from the trials' motions and their one common prior (SC-W030: no trial has a drift).

    Equal to a joint fit with one offset per trial and one drift: each trial contributes its posterior less
    its prior, and the precisions add up.
    """
    fitted = [one for one in alignments if one.source != "supplied" and one.drift_se and one.drift_prior]
    if not fitted:
        raise StrandcastError(
            "SC-W030", "no trial determines the clocks' drift", fix="align trials of this experiment first"
        )
    prior, known = min((one.drift_prior or 0.0, one.known_drift) for one in fitted)
    drift, se = (np.array([getattr(one, name) for one in fitted]) for name in ("drift", "drift_se"))
    before = np.array([(one.drift_prior or 0.0) ** -2 for one in fitted])
    expected = np.array([one.known_drift for one in fitted])
    own = se**-2.0 - before
    informative = own > LEAST_INFORMATION * before
    own = np.where(informative, own, 0.0)
    own_drift = np.where(informative, drift * se**-2.0 - expected * before, 0.0) / np.where(
        informative, own, 1.0
    )
    total = own.sum() + prior**-2.0
    shared = float(((own * own_drift).sum() + known * prior**-2.0) / total)
    apart = np.abs(own_drift - shared) * np.sqrt(own)
    return SharedDrift(
        shared,
        float(total**-0.5),
        tuple(one.trial for one, away in zip(fitted, apart, strict=True) if away > ODD),
    )


def main(arguments: list[str]) -> None:
    """Print the drift that the trials of a results folder share."""
    folders = trial_folders(Path(arguments[0])).values() if arguments else ()
    files = [file for folder in folders if (file := folder / "alignment.json").exists()]
    try:
        found = shared_drift([Alignment.read(file) for file in files])
    except StrandcastError as error:
        sys.exit(str(error))
    print(f"# drift of {len(files)} trials: {found.drift * 1e6:+.1f} ± {found.se * 1e6:.1f} ppm")
    for trial in found.odd:
        print(f"# trial {trial} contradicts it: was its video, or its log, taken by other clocks?")
    print(f"align:\n  drift: [{found.drift:.3e}, {found.se:.2e}]")


if __name__ == "__main__":
    main(sys.argv[1:])
