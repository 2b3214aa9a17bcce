"""The rig: `python -m tests.workflow.rig.process LAB NAME FOLDER PORT_FILE FAULTS`.

It knows the string (the experiment NAME of the project LAB), and of strandcast's files nothing else. Each
connection throws once: a line of JSON with the command comes in, one with the log goes out, and a film
appears in FOLDER a moment later. FAULTS is a JSON object: number of a throw, from 1 -> what goes wrong.
"""

import json
import shutil
import socketserver
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import strandcast.lab.driver as lab
from strandcast.arm.load import load_arm
from strandcast.config.find import find_arm, find_experiment
from strandcast.config.load import load_experiment
from strandcast.core.trajectory import JointTrajectory

BEGUN_LATE_S = 0.8  # after the start of a motion of about 1 s
root, name, folder, port_file = Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]), Path(sys.argv[4])
faults = {int(throw): fault for throw, fault in json.loads(sys.argv[5]).items()}
file = find_experiment(name, root)
experiment = load_experiment(file)
arm = load_arm(find_arm(experiment, file, root))
draw_clocks = lab.draw_clocks
throws = 0
films: list[Path] = []


def throw(command: JointTrajectory) -> dict[str, object]:
    """Throw, and have the film appear; return the answer of the arm."""
    global throws
    throws += 1
    fault = faults.get(throws)
    late = -BEGUN_LATE_S if fault == "late film" else None
    lab.draw_clocks = lambda random: (
        draw_clocks(random) if late is None else replace(draw_clocks(random), camera_lead_s=late)
    )
    made = Path(tempfile.mkdtemp())
    driver = lab.driver_of(lab.LabThrow(name, experiment, throws, made / "truth.parquet"), arm)
    driver.move_to_start(command.q_rad[0])
    recording = driver.play(command, made)
    log = recording.log
    films.append(made / lab.VIDEO)
    wrong = {"no film": [], "two films": [films[-1]] * 2, "other film": films[-2:-1]}
    shown = wrong.get(fault or "", films[-1:])
    threading.Thread(target=film, args=(throws, shown)).start()
    stopped = len(log.time_s) // 2 if fault == "stop" else None
    columns = {key: value[:stopped] for key, value in vars(log).items() if isinstance(value, np.ndarray)}
    return {
        "log": {key: value.tolist() for key, value in columns.items()},
        "status": "ok" if stopped is None else "fault",
        "reason": None if stopped is None else "protective stop: joint 2 met an obstacle",
        "motion_start_s": recording.motion_start_s,
        "motion_end_s": recording.motion_end_s,
    }


def film(number: int, shown: list[Path]) -> None:
    """Write films as a camera's computer does: slowly, under the name that they will have."""
    for which, path in enumerate(shown):
        content = path.read_bytes()
        with (folder / f"C{number:04d}{'b' * which}.mp4").open("wb") as out:
            out.write(content[: len(content) // 2])
            out.flush()
            time.sleep(0.4)
            out.write(content[len(content) // 2 :])


class Arm(socketserver.StreamRequestHandler):
    """The arm's controller."""

    def handle(self) -> None:
        """Answer one request."""
        command = {key: np.array(value) for key, value in json.loads(self.rfile.readline()).items()}
        self.wfile.write(json.dumps(throw(JointTrajectory(**command))).encode() + b"\n")


with socketserver.TCPServer(("127.0.0.1", 0), Arm) as server:
    shutil.rmtree(port_file, ignore_errors=True)
    port_file.write_text(str(server.server_address[1]))
    server.serve_forever()
