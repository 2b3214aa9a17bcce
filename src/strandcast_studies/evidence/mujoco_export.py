"""E of exported MuJoCo models beside our own, on the first throw of the paper's strings in the lab, as JSON.

`python -m strandcast_studies.evidence.mujoco_export 1 2 3 4 5 6 7`; a minute for each string.
"""

import json
import shutil
import sys
import tempfile
from pathlib import Path

from ruamel.yaml import YAML

import strandcast
from strandcast.exports.fitted_model import export_mjcf
from strandcast.stages.run import run_stage
from strandcast_studies.paper.cases import FILE, WHOLE, PaperCase, load_plan, settings_of

STAGES = ("plan", "lab_throw", "ingest", "track", "reconstruct", "align", "score", "estimate")


def errors_of(project: Path, root: Path, number: int) -> dict[str, float]:
    """Throw one string once in an empty project at `root`; return E [m] in MuJoCo and our own."""
    plan = load_plan(project / FILE)
    case = PaperCase(WHOLE, plan.first_seed, number, plan.string(number).target, "default")
    folder = root / "data" / case.name
    folder.mkdir(parents=True)
    with (folder / "experiment.yaml").open("w", encoding="utf-8") as file:
        YAML().dump(settings_of(plan, case), file)
    for stage in ("lab_calibrate", "calibrate"):
        run_stage(stage, root, case.name)
    for stage in STAGES:
        run_stage(stage, root, case.name, 1)
    done = export_mjcf(strandcast.open(root)[case.name].trial(1), root / f"{case.name}.xml")
    return {"own_E_m": done.own_E_m, "E_m": done.E_m, "ratio": done.E_m / done.own_E_m}


def main() -> None:
    """Print the figures of the strings that the command line names."""
    project = Path()
    with tempfile.TemporaryDirectory() as temporary:
        root = Path(temporary)
        shutil.copytree(project / "config" / "arms", root / "config" / "arms")
        found = {f"string {number}": errors_of(project, root, int(number)) for number in sys.argv[1:]}
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
