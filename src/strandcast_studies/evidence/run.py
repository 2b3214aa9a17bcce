"""Evidence on real data: figures as JSON on standard output, as text on standard error.

    python -m strandcast_studies.evidence.run [PART…]

The environment variable STRANDCAST_REAL_DATA gives the data folder; missing data are skipped with a reason.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Collection
from pathlib import Path

from strandcast_studies.evidence import (
    captured_weights,
    counts,
    deform_dlo,
    franka_stills,
    mbest_stills,
    pac_tip,
    pendulum_video,
    string_pendulum,
)
from strandcast_studies.evidence.figure import Figure, Skipped

VARIABLE = "STRANDCAST_REAL_DATA"

Measure = Callable[[Path], list[Figure]]
PARTS: dict[str, tuple[str, Measure]] = {
    "pac_cable.tip": ("pac_cable", pac_tip.measure),
    "pac_cable.weight": ("pac_cable", captured_weights.measure),
    "pac_cable.by_count": ("pac_cable", counts.measure),
    "string_pendulum": ("string_pendulum", string_pendulum.measure),
    "pendulum_video": ("string_pendulum", pendulum_video.measure),
    "mbest_s1": ("mbest_s1", mbest_stills.measure),
    "franka_stills": ("franka_cable_stills", franka_stills.measure),
    "deform_dlo.by_count": ("deform_dlo", counts.measure),
    "deform_dlo": ("deform_dlo", deform_dlo.measure),
}


def measure_all(data: Path | None, parts: Collection[str] = tuple(PARTS)) -> list[Figure | Skipped]:
    """Measure every one of these parts, if its data exist."""
    results: list[Figure | Skipped] = []
    for name, (folder, measure) in ((name, PARTS[name]) for name in parts):
        if data is None:
            results.append(Skipped(name, f"{VARIABLE} does not give an existing folder"))
        elif not (data / folder).is_dir():
            results.append(Skipped(name, f"{data} has no folder {folder}"))
        else:
            print(f"{name} …", file=sys.stderr, flush=True)
            try:
                results += measure(data / folder)
            except FileNotFoundError as missing:
                results.append(Skipped(name, f"{missing.filename} is missing"))
    return results


def in_words(result: Figure | Skipped) -> str:
    """Return a figure as a line of text."""
    if isinstance(result, Skipped):
        return f"{result.name}: skipped, {result.reason}"
    value = "not found" if result.value is None else f"{result.value:.3g} {result.unit}"
    if result.target is None:
        return f"{result.name}: {value}"
    return f"{result.name}: {value} (target {result.target:.3g}: {'met' if result.met else 'MISSED'})"


def main(arguments: list[str] | None = None) -> None:
    """Print the evidence."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"default: all of {', '.join(PARTS)}")
    parts = parser.parse_args(arguments).parts or list(PARTS)
    if unknown := set(parts) - set(PARTS):
        parser.error(f"no such part: {', '.join(sorted(unknown))}")
    named = os.environ.get(VARIABLE)
    data = Path(named) if named and Path(named).is_dir() else None
    results = measure_all(data, parts)
    print("\n".join(in_words(result) for result in results), file=sys.stderr)
    json.dump([result.record() for result in results], sys.stdout, indent=2, allow_nan=False)
    print()


if __name__ == "__main__":
    main()
