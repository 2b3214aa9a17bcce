"""Record every result of a fixed set of runs, and compare two recordings, before and after a refactoring.

    python tests/regression/snapshot.py record before.json      # in a checkout of the old state
    python tests/regression/snapshot.py record after.json       # in the new state
    python tests/regression/snapshot.py compare before.json after.json

A file is *identical* if its bytes are, *equal* if all its values are (a table's columns, a record's fields),
and has *equal numbers* if only names, words, or the order of fields differ. Everything else is listed, and
`compare` ends with exit code 1. Numbers depend on the processor: record both on the same machine.
"""

import argparse
import hashlib
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

PROJECT = Path(__file__).resolve().parents[2]

# Two lab experiments beside the demo: another string each, a bar and a swing, other settings.
BAR = {
    "title": "Regression: string 4 at a bar, with an LED",
    "string": {"length_m": 0.51, "stiff_sections": [{"from_m": 0.2, "to_m": 0.3}]},
    "arm": "planar3",
    "objective": {"kind": "segment", "ends_m": [[0.55, 0.40], [0.60, 0.50]]},
    "max_trials": 2,
    "min_trials": 2,
    "seed": 11,
    "workspace_m": {"x_m": [-0.95, 1.45], "y_m": [-0.55, 0.95]},
    "estimate": {"forces": ["rest_curl", "drag_along", "stiff_bend"], "evaluations": 2000},
    "plan": {"evaluations": 600},
    "align": {"led": {"place_m": [-0.60, 0.40]}},
    "lab": {"string": "paper-4", "servo": "stiff"},
}
SWING = {
    "title": "Regression: a drawn string, swung high",
    "string": {"length_m": 0.40, "points": 12},
    "arm": "planar3",
    "target_m": [0.45, 0.55],
    "objective": {"kind": "swing", "height_m": 0.6},
    "max_trials": 2,
    "min_trials": 2,
    "seed": 12,
    "start_string": "minima",
    "workspace_m": {"x_m": [-0.85, 1.35], "y_m": [-0.45, 0.90]},
    "estimate": {"search": "descent", "evaluations": 1500, "clamp_offset_sd_rad": 0.05},
    "plan": {"evaluations": 600},
    "lab": {"string": {"linear_density_kg_m": 0.006, "curl_rad_m": 1.0}, "servo": "pd"},
}
CAPTURE = {
    "title": "Regression: a swing measured by motion capture",
    "string": {"length_m": 0.5, "points": 8},
    "arm": "planar3",
    "target_m": [0.2, -0.3],
    "estimate": {"evaluations": 1000, "horizon_s": None},
}


def with_plane(settings: dict[str, Any]) -> dict[str, Any]:
    """Return settings with markers in the corners of the workspace."""
    (left, right), (low, high) = settings["workspace_m"]["x_m"], settings["workspace_m"]["y_m"]
    places = [
        (x, y) for y in (high - 0.1, low + 0.1) for x in (left + 0.1, 0.5 * (left + right), right - 0.1)
    ]
    markers = [{"id": k, "x_m": x, "y_m": y} for k, (x, y) in enumerate(places)]
    return settings | {"camera": {"plane": {"dictionary": "DICT_4X4_50", "size_m": 0.08, "markers": markers}}}


def capture_csv() -> str:
    """Return a damped swing under a moving hand as a motion capture system writes it."""
    lines = ["t,x,y,angle,x_mid,y_mid,x_tip,y_tip"]
    for k in range(400):
        t = k / 200
        hand = (0.1 + 0.05 * math.sin(3 * t), 0.2)
        angle = 0.6 * math.exp(-0.4 * t) * math.cos(4.2 * t)
        tip_angle = 0.7 * math.exp(-0.4 * t) * math.cos(4.2 * t - 0.3)
        middle = (hand[0] + 0.25 * math.sin(angle), hand[1] - 0.25 * math.cos(angle))
        tip = (middle[0] + 0.24 * math.sin(tip_angle), middle[1] - 0.24 * math.cos(tip_angle))
        row = (t, *hand, -math.pi / 2, *middle, *tip)
        lines.append(",".join(f"{value:.6f}" for value in row))
    return "\n".join(lines) + "\n"


def run(root: Path, *line: str | Path) -> None:
    """Run Python with a line of arguments in the folder."""
    print(">", *line, file=sys.stderr, flush=True)
    environment = os.environ | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run([sys.executable, *map(str, line)], cwd=root, env=environment, check=True)


def experiment(root: Path, name: str, settings: dict[str, Any]) -> None:
    """Write an experiment's file; JSON is YAML."""
    folder = root / "data" / name
    folder.mkdir(parents=True)
    (folder / "experiment.yaml").write_text(json.dumps(settings, indent=1), encoding="utf-8")


def demo(root: Path) -> None:
    """Throw the demo; then hand its motion over in every form."""
    run(root, "-m", "strandcast", "run", "demo")
    motion = "data/demo/trial-01/motion.json"
    for form, name in (("csv", "motion.csv"), ("ros", "goal.json")):
        out = root / "results" / "export" / name
        out.parent.mkdir(parents=True, exist_ok=True)
        run(root, "-m", "strandcast", "export", "motion", motion, "--as", form, "--out", out)


def bar(root: Path) -> None:
    """Throw at a bar, with an LED and a stiff section."""
    experiment(root, "bar", with_plane(BAR))
    run(root, "-m", "strandcast", "run", "bar")


def swing(root: Path) -> None:
    """Swing a drawn string high, fitted by CMA-ES."""
    experiment(root, "swing", with_plane(SWING))
    run(root, "-m", "strandcast", "run", "swing")


def capture(root: Path) -> None:
    """Import a track that was measured elsewhere, and report on it."""
    experiment(root, "capture", CAPTURE)
    (root / "capture.csv").write_text(capture_csv(), encoding="utf-8")
    markers = ("--marker", "0.25:x_mid,y_mid", "--marker", "0.49:x_tip,y_tip")
    run(root, "-m", "strandcast", "import", "track", "capture", "1", "capture.csv", *markers)
    run(root, "-m", "strandcast", "run", "capture")


def loop(root: Path) -> None:
    """Run the whole loop on two strings and two seeds, with supplied tracks."""
    work = root / "results" / "loop"
    run(
        root,
        "-m",
        "strandcast_studies.benchmarks.loop.run",
        "--strings",
        "1,3",
        "--seeds",
        "2001-2002",
        "--out",
        work / "runs.json",
        "--work",
        work,
    )
    shutil.rmtree(next(work.rglob("config")), ignore_errors=True)


def real(root: Path) -> None:
    """Predict real, measured motion."""
    line = [sys.executable, "-m", "strandcast_studies.evidence.run"]
    print(">", *line, file=sys.stderr, flush=True)
    done = subprocess.run(line, cwd=root, check=True, stdout=subprocess.PIPE)
    (root / "results" / "real.json").write_bytes(done.stdout)


CASES: dict[str, Callable[[Path], None]] = {
    case.__name__: case for case in (demo, bar, swing, capture, loop, real)
}
# Files that no result depends on: logs, notes, times of this machine, and those of Snakemake.
IGNORED = re.compile(r"(^|/)(logs|made|\.snakemake|boards)(/|$)|\.jsonl$")
NOT_NUMBERS = re.compile(r"sha256|hash|version|schema|made_by")
TIMES = re.compile(r"(cpu|wall)_s$|_cpu|_ms_per_frame|seconds")


def record(out: Path, names: list[str]) -> None:
    """Run the cases in a fresh folder and write what every file holds."""
    cases: dict[str, Any] = {}
    for name in names:
        with tempfile.TemporaryDirectory(prefix="strandcast-regression-") as folder:
            root = Path(folder)
            for part in ("Snakefile", "workflow", "config"):
                source = PROJECT / part
                (shutil.copytree if source.is_dir() else shutil.copy)(source, root / part)
            (root / "results").mkdir()
            CASES[name](root)
            files = sorted(path for top in ("data", "results") for path in (root / top).rglob("*"))
            wanted = {str(path.relative_to(root)): path for path in files if path.is_file()}
            cases[name] = {k: fingerprint(p) for k, p in wanted.items() if not IGNORED.search(k)}
        before = json.loads(out.read_text()) if out.is_file() else {}
        out.write_text(json.dumps(before | cases, indent=0), encoding="utf-8")


def fingerprint(path: Path) -> dict[str, Any]:
    """Return a file's hash, and its values where it is a table or a record."""
    data = path.read_bytes()
    whole: dict[str, Any] = {"sha256": hashlib.sha256(data).hexdigest()}
    if path.suffix == ".parquet":
        table = pq.read_table(path)
        whole["values"] = {
            name: hashlib.sha256(repr(table.column(name).to_pylist()).encode()).hexdigest()
            for name in table.column_names
        }
    elif path.suffix == ".json":
        whole["values"] = dict(leaves(json.loads(data)))
    elif path.suffix == ".html":
        text = re.sub(r"(?s)<(style|script|svg).*?</\1>|<[^>]*>", " ", data.decode())
        whole["numbers"] = sorted(Counter(re.findall(r"\d+(?:\.\d+)?", text)).items())
    return whole


def leaves(node: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of a record with their places."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield from leaves(value, f"{place}.{key}")
    elif isinstance(node, list):
        for key, value in enumerate(node):
            yield from leaves(value, f"{place}.{key}")
    elif not TIMES.search(place):
        yield place, node


def numbers(file: dict[str, Any]) -> Counter[str]:
    """Return the numbers in a file (of a table, the columns' hashes), regardless of their names."""
    values = (value for key, value in file.get("values", {}).items() if not NOT_NUMBERS.search(key))
    return Counter(str(v) for v in values if not isinstance(v, bool | str) or len(str(v)) == 64)


def compare(old: dict[str, Any], new: dict[str, Any], renamed: list[tuple[str, str]]) -> bool:
    """Print the differences of two recordings; return whether a number changed or is missing, or a file."""
    failed = False
    for case in sorted(old.keys() & new.keys()):
        before, after, count = old[case], new[case], Counter[str]()
        for name, file in before.items():
            there = name
            for pattern, replacement in renamed:
                there = re.sub(pattern, replacement, there)
            other = after.get(there)
            kind, detail = difference(file, other, there)
            count[kind] += 1
            if kind in ("gone", "CHANGED"):
                failed = True
            if detail:
                print(f"  {case}: {name}: {kind}{detail}")
        added = sorted(after.keys() - before.keys())
        print(f"{case}: {dict(count)}" + (f", {len(added)} new names: {added[:12]}" if added else ""))
    missing = sorted(old.keys() - new.keys())
    print(f"not recorded again: {missing}" if missing else "all cases recorded again")
    return failed or bool(missing)


def difference(old: dict[str, Any], new: dict[str, Any] | None, name: str) -> tuple[str, str]:
    """Return how a file differs, in a word, and the most important changes."""
    if new is None:
        return "gone", ""
    if old["sha256"] == new["sha256"]:
        return "identical", ""
    if name.endswith(".html"):
        return ("equal" if old.get("numbers") == new.get("numbers") else "page differs"), ""
    if "values" not in old:
        return "CHANGED", " (bytes)"
    if old["values"] == new.get("values"):
        return "equal", ""
    moved = {
        key
        for key in old["values"].keys() & new["values"].keys()
        if old["values"][key] != new["values"][key] and not NOT_NUMBERS.search(key)
    }
    lost = numbers(old) - numbers(new)
    real_loss = [
        key
        for key, value in old["values"].items()
        if str(value) in lost
        and not NOT_NUMBERS.search(key)
        and (name.endswith(".parquet") or not isinstance(value, str))  # hashes of other files are words
    ]
    if not real_loss:
        words = sorted(moved)[:3]
        return "equal numbers", f": {words}" if words else ""
    changes = [f"{k}: {old['values'][k]} -> {new['values'].get(k)}" for k in real_loss[:6]]
    return "CHANGED", "\n      " + "\n      ".join(changes)


def main() -> None:
    """Record, or compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    doing = parser.add_subparsers(dest="doing", required=True)
    recording = doing.add_parser("record")
    recording.add_argument("out", type=Path)
    recording.add_argument("cases", nargs="*", default=[])
    comparing = doing.add_parser("compare")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    comparing.add_argument("--renamed", nargs=2, action="append", default=[], metavar=("PATTERN", "NAME"))
    chosen = parser.parse_args()
    if chosen.doing == "record":
        record(chosen.out.resolve(), chosen.cases or list(CASES))
        return
    old, new = json.loads(chosen.old.read_text()), json.loads(chosen.new.read_text())
    sys.exit(compare(old, new, chosen.renamed))


if __name__ == "__main__":
    main()
