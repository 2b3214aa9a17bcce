"""The program is run, by Python: its `def`, `if` and `while` differ from Python's in `end` alone.

That is no controller: what servoj, movej and popup do is not shown here, only what the program asks of them.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from strandcast.errors import StrandcastError
from strandcast.executor.handover.handover import prepare
from strandcast.executor.handover.urscript import program_text
from strandcast.records.motion import Motion

HELD = [np.pi, np.pi / 2, 0.0]


class HaltError(Exception):
    pass


class Controller:
    """What the program calls, in the order of the calls."""

    def __init__(self, away_rad: float = 0.0, speed_rad_s: float = 0.0) -> None:
        self.calls: list[tuple] = []
        self.q = [0.0] * 6
        self.away_rad, self.speed_rad_s = away_rad, speed_rad_s

    def movej(self, q, a, v):
        self.calls.append(("movej", a, v))
        self.q = [*q[:5], q[5] + self.away_rad]

    def servoj(self, q, t, lookahead_time, gain):
        self.calls.append(("servoj", q, t, lookahead_time, gain))

    def popup(self, text, title, warning, error, blocking):
        assert blocking
        assert len(text) < 200
        self.calls.append(("popup", text, error))

    def run(self, text: str) -> None:
        python = "\n".join(
            line.replace("halt", "raise HaltError") if line.strip() == "halt" else line
            for line in text.splitlines()
            if line.strip() != "end"
        )
        names = {
            name: lambda *args, name=name: self.calls.append((name, *args))
            for name in ("textmsg", "sleep", "stopj", "set_standard_digital_out")
        }
        names |= {"movej": self.movej, "servoj": self.servoj, "popup": self.popup, "norm": abs}
        names["get_actual_joint_positions"] = lambda: self.q
        names["get_actual_joint_speeds"] = lambda: [self.speed_rad_s] * 6
        names["HaltError"] = HaltError
        exec(compile(python, "throw.script", "exec"), names)
        names["strandcast_throw"]()

    def named(self, name: str) -> list[tuple]:
        return [call for call in self.calls if call[0] == name]


@pytest.fixture
def program(export, ur5e, ur_file):
    """Return what gives the program's text."""
    return lambda **options: export(ur_file, ur5e, "urscript", "throw.script", **options).read_text()


@pytest.mark.parametrize(("rate_hz", "scale"), [(None, 1.0), (125.0, 1.0), (None, 4.0)])
def test_the_program_plays_the_motion(program, ur_file, rate_hz, scale):
    text = program(rate_hz=rate_hz, time_scale=scale)
    controller = Controller()
    controller.run(text)
    expected = Motion.read(ur_file).trajectory().resampled(1.0 / ((rate_hz or 500.0) * scale))
    servo = controller.named("servoj")
    q = np.array([call[1] for call in servo])
    rows = len(expected.time_s)
    np.testing.assert_allclose(q[:rows, 1:4], expected.q_rad, atol=1e-9)
    np.testing.assert_allclose(q[:, [0, 4, 5]], np.tile(HELD, (len(q), 1)), atol=1e-9)
    np.testing.assert_array_equal(q[rows:], np.tile(q[rows - 1], (len(q) - rows, 1)))
    assert len(q) - rows == round(0.3 * (rate_hz or 500.0))
    assert {call[2:] for call in servo} == {(1.0 / (rate_hz or 500.0), 0.03, 2000)}


def test_the_program_asks_moves_slowly_checks_asks_again_plays_and_stops(program, ur_file):
    controller = Controller()
    controller.run(program(sync_output=3))
    order = [call[0] for call in controller.calls if call[0] != "textmsg"]
    assert [name for name, before in zip(order, [None, *order], strict=False) if name != before] == [
        "popup",
        "movej",
        "sleep",
        "popup",
        "set_standard_digital_out",
        "servoj",
        "stopj",
        "set_standard_digital_out",
    ]
    assert controller.named("movej") == [("movej", 0.5, 0.25)]
    assert controller.named("set_standard_digital_out") == [
        ("set_standard_digital_out", 3, True),
        ("set_standard_digital_out", 3, False),
    ]
    sha256 = Motion.read(ur_file).content_sha256()
    assert sha256[:8] in controller.named("popup")[0][1]
    assert "THROW" in controller.named("popup")[1][1]
    slow = Controller()
    slow.run(program(time_scale=4.0))
    assert "4 times slower" in slow.named("popup")[1][1]
    assert not slow.named("set_standard_digital_out")


def test_the_program_uses_the_drivers_settings(ur5e, ur_file):
    settings = {"host": "x", "rate_hz": 125, "look_ahead_s": 0.05, "gain": 300.0, "sync_output": 5}
    arm = replace(ur5e, driver="ur", driver_settings=settings)
    controller = Controller()
    controller.run(program_text(prepare(ur_file, arm, 0.3)))
    assert {call[2:] for call in controller.named("servoj")} == {(0.008, 0.05, 300)}
    assert controller.named("set_standard_digital_out")[0][1] == 5


@pytest.mark.parametrize("controller", [Controller(away_rad=0.011), Controller(speed_rad_s=-0.02)])
def test_the_program_halts_unless_the_arm_is_at_rest_at_the_start(program, controller):
    with pytest.raises(HaltError):
        controller.run(program())
    assert controller.named("popup")[-1][2]
    assert not controller.named("servoj")


def test_a_controller_can_parse_the_program(program, ur_file):
    text = program(sync_output=0)
    assert text.isascii()
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
    opened = [line for line in lines if line.rstrip().endswith(":")]
    assert len(opened) == sum(line.strip() == "end" for line in lines) > 5
    depth = 0
    for line in lines:
        depth -= line.strip() == "end"
        assert len(line) - len(line.lstrip()) == 2 * depth or not line.strip()
        depth += line.rstrip().endswith(":")
        assert depth >= (line is not lines[-1])
    assert max(map(len, text.splitlines())) < 1000
    numbers = re.findall(r"(?<![\w.])-?\d+\.\d+", text)
    assert np.isfinite(np.array(numbers, float)).all()
    code = re.sub(r'"[^"]*"', "", "\n".join(lines))  # the hash may hold an 1e5
    assert not re.search(r"\bnan\b|\binf\b|\d[eE][-+]?\d", code)
    assert f"# motion_sha256: {Motion.read(ur_file).content_sha256()}" in text.splitlines()


@pytest.mark.parametrize(
    ("options", "field"),
    [({"sync_output": 8}, "sync-output"), ({"sync_output": -1}, "sync-output"), ({"rate_hz": 250.0}, "rate")],
)
def test_options_that_no_ur_has_are_refused(program, options, field):
    with pytest.raises(StrandcastError, match=f"SC-E004.*{field}"):
        program(**options)
