"""Throws of arms that their files describe wrongly by millimetres: what `strandcast rig` says of each.

`python -m strandcast_studies.misstated_rigs` makes a project with one experiment per case, as
`strandcast_studies.bad_throws` does, and throws in each a few times: the virtual lab has the real arm, the
project the stated one. It prints what `strandcast rig` reports of each.
"""

import argparse
import subprocess
import sys
from pathlib import Path

from strandcast_studies.bad_throws import BadThrow, make_bad_throws

TRIALS = 3
CASES: dict[str, BadThrow] = {
    "rig-01": BadThrow("none"),
    "rig-02": BadThrow(
        "link 2 is 4 mm longer than the arm's file says",
        urdf=(r'(<joint name="joint_3".*?<origin xyz=")0\.25 ', r"\g<1>0.254 "),
    ),
    "rig-03": BadThrow(
        "joint 2 reads 5 mrad too little",
        urdf=(r'(<joint name="joint_2".*?<origin xyz="0\.30 0 0" rpy=")0 0 0"', r'\g<1>0 -0.005 0"'),
    ),
    "rig-04": BadThrow(
        "the clamp holds the string 5 mm to the left of where the arm's file says",
        toml=(r"offset_m = \[0\.0, 0\.0\] ", "offset_m = [0.0, 0.005] "),
    ),
    "rig-05": BadThrow("none, another rig"),
    "rig-06": BadThrow(
        "link 1 is 3 mm shorter than the arm's file says",
        urdf=(r'(<joint name="joint_2".*?<origin xyz=")0\.30 ', r"\g<1>0.297 "),
    ),
    "rig-07": BadThrow("none, a third rig"),
    "rig-08": BadThrow(
        "joint 1 reads 8 mrad too little",
        urdf=(r'(<joint name="joint_1".*?<origin xyz="0 0 0" rpy=")0 0 0"', r'\g<1>0 -0.008 0"'),
    ),
}


def report(root: Path, name: str) -> str:
    """Return what `strandcast rig` says of an experiment."""
    command = [sys.executable, "-m", "strandcast", "rig", name]
    return subprocess.run(command, cwd=root, check=False, capture_output=True, text=True).stdout


def main(arguments: list[str] | None = None) -> None:
    """Throw the cases that are named, or all, and print what is reported of their arms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", nargs="*", choices=[[], *CASES], default=[], help="default: all")
    parser.add_argument("--root", type=Path, default=Path("results/misstated-rigs"))
    parser.add_argument("--trials", type=int, default=TRIALS)
    parser.add_argument("--cores", type=int, default=2)
    given = parser.parse_args(arguments)
    names = given.cases or list(CASES)
    make_bad_throws(given.root, {name: CASES[name] for name in names}, given.cores, given.trials)
    for name in names:
        print(f"{name}: {CASES[name].cause}\n{report(given.root, name)}")


if __name__ == "__main__":
    main()
