"""All evidence on real data: figures as JSON on standard output, as text on standard error.

The environment variable STRANDCAST_REAL_DATA gives the data folder; missing data are skipped with a reason.
"""

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

from strandcast_studies.evidence import (
    captured_weights,
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
    "string_pendulum": ("string_pendulum", string_pendulum.measure),
    "pendulum_video": ("string_pendulum", pendulum_video.measure),
    "mbest_s1": ("mbest_s1", mbest_stills.measure),
    "franka_stills": ("franka_cable_stills", franka_stills.measure),
    "deform_dlo": ("deform_dlo", deform_dlo.measure),
}


def measure_all(data: Path | None) -> list[Figure | Skipped]:
    """Measure every part whose data exist."""
    results: list[Figure | Skipped] = []
    for name, (folder, measure) in PARTS.items():
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


def main() -> None:
    """Print the evidence."""
    named = os.environ.get(VARIABLE)
    data = Path(named) if named and Path(named).is_dir() else None
    results = measure_all(data)
    print("\n".join(in_words(result) for result in results), file=sys.stderr)
    json.dump([result.record() for result in results], sys.stdout, indent=2, allow_nan=False)
    print()


if __name__ == "__main__":
    main()
