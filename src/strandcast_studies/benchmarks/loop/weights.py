"""How far fitted weights are from those that the lab threw, in runs of `loop.drawn` with ``--work``.

python -m strandcast_studies.benchmarks.loop.drawn --work results/drawn
python -m strandcast_studies.benchmarks.loop.weights results/drawn --trial 2

Masses are relative to the string's per length, as in `estimate.json`.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from strandcast.records.estimate import Estimate
from strandcast.stages.context import context_of

WITHIN = (0.1, 0.2)  # of the true weight


def weight_ratios(root: Path, name: str, trial: int) -> list[float]:
    """Return fitted over true mass of each weight."""
    context = context_of(root, name)
    lab, folder = context.settings.lab, context.folder.trial(trial).results
    assert lab is not None
    assert not isinstance(lab.string, str)
    fit = Estimate.read(folder / "estimate.json")
    assert fit.length_m is not None
    plain_kg = lab.string.linear_density_kg_m * fit.length_m / context.settings.string.n
    fitted_kg = plain_kg * np.array([weight.value for weight in fit.weights])
    thrown_kg = np.array([weight.mass_kg for weight in context.settings.string.weights], float)
    return list(fitted_kg / thrown_kg)


def main(arguments: list[str] | None = None) -> None:
    """Print quantiles of the ratios, and the shares of weights that were found closely."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--trial", type=int, default=2, help="the trial after which the string was fitted")
    options = parser.parse_args(arguments)
    fits = options.folder.glob(f"results/*/trial-{options.trial:02d}/estimate.json")
    names = sorted(path.parts[-3] for path in fits)
    ratios = np.array([r for name in names for r in weight_ratios(options.folder, name, options.trial)])
    report = {
        "weights": len(ratios),
        "ratio": {f"p{q}": round(float(np.percentile(ratios, q)), 3) for q in (5, 25, 50, 75, 95)},
        "within": {f"{share:.0%}": round(float((abs(ratios - 1.0) <= share).mean()), 3) for share in WITHIN},
    }
    print(json.dumps(report, indent=1))


if __name__ == "__main__":
    main()
