"""What a sitting does with files, programs and answers; `test_sitting.py` holds whole sittings."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from tests.faults.small import NAME, REAL, make_project
from tests.forked import run_module
from tests.report.chromium import Browser

from strandcast.errors import ABORTED, LOG_INCOMPLETE, REFUSED, StrandcastError
from strandcast.executor.preflight import PlayOptions
from strandcast.stages.context import Context, context_of
from strandcast.workflow import sitting as room
from strandcast.workflow import watched_folder
from strandcast.workflow.sitting import Sitting, hold, put_aside
from strandcast.workflow.terminal import Terminal
from strandcast.workflow.watched_folder import PICTURE_FOLDER, Unusable, copy_film, listing, new_files


class Typing:
    """A person who types some lines, then nothing."""

    def __init__(self, *lines: str) -> None:
        self.lines, self.said = list(lines), []

    def forget(self) -> None:
        pass

    def typed(self) -> str | None:
        return self.lines.pop(0) if self.lines else None

    def say(self, text: str) -> None:
        self.said.append(text)

    show = show_pages = say


def project(folder: Path, settings: str) -> Context:
    root = make_project(folder)
    (root / "config" / "experiments" / f"{NAME}.yaml").write_text(REAL + settings)
    (root / "films").mkdir()
    return context_of(root, NAME)


def sitting_of(context: Context, *lines: str) -> Sitting:
    return Sitting(context.folder.root, context.name, PlayOptions(), Typing(*lines))


def test_new_films_are_those_since_the_throw_that_are_complete(
    tmp_path: Path, finished: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    films = tmp_path / "films"
    films.mkdir()
    film = (finished / "data" / NAME / "trial-01" / "video.mp4").read_bytes()
    monkeypatch.setattr(watched_folder.time, "sleep", lambda _: None)
    for name in (b"old.mp4", b"\xe9t\xe9.mp4"):
        Path(os.fsdecode(bytes(films) + b"/" + name)).write_bytes(film)
    (films / "lost").symlink_to("nowhere")
    before = json.loads(json.dumps(listing(films)))

    def new() -> list[str]:
        return [path.name for path in new_files(films, before, (".mp4", ".avi", PICTURE_FOLDER))]

    for name in ("notes.txt", ".x.mp4"):
        (films / name).write_bytes(film)
    (films / "empty").mkdir()
    assert new() == []
    (films / "new.mp4").write_bytes(film)
    (films / "cut.mp4").write_bytes(film[: len(film) // 2])
    assert new() == []  # it may be the one
    (films / "cut.mp4").unlink()
    (films / "old.mp4").write_bytes(film + film)  # written again, under its old name
    (films / "pictures").mkdir()
    (films / "pictures" / "0001.png").write_bytes(b"a picture")
    assert new() == ["new.mp4", "old.mp4", "pictures"]
    before["device"] += 1  # it was mounted again
    assert new() == ["new.mp4", "old.mp4", "pictures"]
    before["files"]["gone.mp4"] = [1, 1, 1]  # another one is mounted there
    assert new() == []
    before["device"] -= 1
    assert new() == ["new.mp4", "old.mp4", "pictures"]
    monkeypatch.setattr(watched_folder.time, "sleep", lambda _: (films / "new.mp4").open("ab").write(b"more"))
    assert new() == []
    with pytest.raises(Unusable, match=r"new\.mp4 in .* still changes"):
        listing(films)
    copy_film(films / "pictures", tmp_path / "trial")
    assert (tmp_path / "trial" / "video" / "0001.png").read_bytes() == b"a picture"


def test_a_throw_that_left_nothing_is_known_to_have_been_cut_off(tmp_path: Path) -> None:
    context = project(tmp_path / "project", "")
    room._write_record(context, {"trial": 1, "folder": None, "thrown": True})
    for _ in range(2):
        room._finish_last(sitting_of(context))
    why = [path.read_text() for path in sorted((context.folder.data / "aside").glob("*/why.txt"))]
    assert why == [room.CUT_OFF + "\n"]


def test_a_motion_that_was_planned_again_is_not_the_one_that_was_allowed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = project(tmp_path / "project", "")
    of = {name: SimpleNamespace(content_sha256=lambda name=name: name) for name in "ab"}
    monkeypatch.setattr(room, "read_motion", lambda path: of["b"])
    shown = SimpleNamespace(motion_path=tmp_path / "motion.json", motion=of["a"])
    with pytest.raises(Unusable, match="another motion was planned meanwhile"):
        room._make_ready(sitting_of(context), context, context.folder.trial(1), shown, hand_over=True)
    assert not context.folder.trial(1).data.exists()


@pytest.mark.parametrize(("took_s", "asked"), [(0.0, 1), (60.0, 2)])
def test_a_yes_does_not_last_longer_than_a_slow_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, took_s: float, asked: int
) -> None:
    context, questions, played, now = project(tmp_path / "project", ""), [], [], [0.0]
    preflight = SimpleNamespace(short_hash="1a2b3c4d")
    monkeypatch.setattr(room, "_proposed", lambda *_: (preflight, "driver"))
    monkeypatch.setattr(room, "_write_pages", lambda *_: None)
    monkeypatch.setattr(room, "_allowed", lambda *_: questions.append(1) or True)
    monkeypatch.setattr(room, "_make_ready", lambda *_, **__: now.append(took_s))
    monkeypatch.setattr(room, "play", lambda *_: played.append(1))
    monkeypatch.setattr(room.time, "monotonic", lambda: now[-1])
    (context.folder.results / "sitting").mkdir(parents=True)
    assert room._throw(sitting_of(context), context, context.folder.trial(1))
    assert (len(questions), len(played)) == (asked, 1)


@pytest.mark.parametrize(
    ("exit_code", "left", "thrown"),
    [(REFUSED, [], False), (ABORTED, [], False), (ABORTED, ["joints.csv"], True), (LOG_INCOMPLETE, [], True)],
    ids=["refused", "stopped on the way to the start", "stopped in the throw", "no log"],
)
def test_an_arm_that_did_not_throw_puts_no_trial_aside(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, exit_code: int, left: list[str], thrown: bool
) -> None:
    context = project(tmp_path / "project", "")
    trial = context.folder.trial(1)

    def play(*_: object) -> None:
        for name in left:
            trial.data.mkdir(parents=True)
            (trial.data / name).touch()
        raise StrandcastError("SC-X011", "it was stopped", exit_code=exit_code)

    preflight = SimpleNamespace(short_hash="abcd1234")
    monkeypatch.setattr(room, "_proposed", lambda *_: (preflight, "driver"))
    for name in ("_write_pages", "_make_ready"):
        monkeypatch.setattr(room, name, lambda *_, **__: None)
    monkeypatch.setattr(room, "play", play)
    sitting = sitting_of(context, "abcd1234")
    assert room._throw(sitting, context, trial)
    assert room._record(context)["thrown"] is thrown
    assert ("nothing was thrown" in sitting.person.said) is not thrown


def test_trials_are_put_aside_without_replacing_one_another(tmp_path: Path) -> None:
    context = project(tmp_path / "project", "")
    trial, folders = context.folder.trial(1), []
    for reason in ("first", "second"):
        for name in ("data", "results"):
            getattr(trial, name).mkdir(parents=True, exist_ok=True)
        (trial.data / "run.json").write_text(reason)
        (trial.results / "track.json").write_text(reason)
        (trial.results / "motion.json").write_text("planned")
        (trial.results / "made").mkdir(exist_ok=True)
        for stage in ("plan", "track"):
            (trial.results / "made" / f"{stage}.json").write_text(stage)
        folders.append(put_aside(context, trial, reason))
        assert context.folder.thrown_trials() == []
    for folder, reason in zip(folders, ("first", "second"), strict=True):
        names = ("why.txt", "run.json", f"results-{folder.name}/track.json")
        assert {(folder / name).read_text().strip() for name in names} == {reason}
    kept = {path.relative_to(trial.results).as_posix() for path in trial.results.rglob("*.json")}
    assert kept == {"motion.json", "made/plan.json"}  # so that it is not planned again


@pytest.mark.parametrize(
    ("program", "words"),
    [
        ("'false'", "ended with exit code 1"),
        ("no-such-program", "No such file"),
        ("sleep 20", "took longer than 0.2 s"),
    ],
)
def test_a_program_that_fails_says_so(tmp_path: Path, program: str, words: str) -> None:
    context = project(tmp_path / "project", f"sitting: {{before: {program}, wait_s: 0.2}}\n")
    with pytest.raises(Unusable, match=words):
        room._run_program(sitting_of(context), context, "before", context.folder.trial(1), tmp_path)


def test_a_program_is_told_which_throw_it_is(tmp_path: Path) -> None:
    context = project(tmp_path / "project", 'sitting: {after: "cp {motion} armed-{trial}"}\n')
    trial = context.folder.trial(3)
    trial.results.mkdir(parents=True)
    (trial.results / "motion.json").write_text("planned")
    room._run_program(sitting_of(context), context, "after", trial, trial.results / "motion.json")
    assert (tmp_path / "project/armed-3").read_text() == "planned"
    file = tmp_path / "project/config/experiments" / f"{NAME}.yaml"
    file.write_text(REAL + 'sitting: {after: "echo \'open"}\n')
    with pytest.raises(StrandcastError, match=r"sitting\.after"):
        context_of(tmp_path / "project", NAME)


def test_only_the_hash_of_this_motion_moves_the_arm() -> None:
    for lines, allowed in ((["", "y", "1a2b3c4e", "q"], False), (["yes", "1a2b3c4d"], True)):
        person = Typing(*lines)
        assert room._allowed(person, "1a2b3c4d") is allowed
        assert person.lines == []


def test_a_throw_that_leaves_no_film_is_put_aside(tmp_path: Path) -> None:
    context = project(tmp_path / "project", "sitting: {folder: films, wait_s: 0.1}\n")
    for lines, words in ((["what", "none"], "there is no film"), ([], "no complete film came within 0.1 s")):
        with pytest.raises(Unusable, match=words):
            room._await_film(sitting_of(context, *lines), context, context.folder.trial(1), lambda _: [])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("seed: 3", "seed: 3\nlab: {}"), "the lab throws by itself"),
        (("target_m: [0.50, 0.50]\n", ""), "no target"),
    ],
)
def test_what_no_arm_throws_is_refused(tmp_path: Path, change: tuple[str, str], words: str) -> None:
    context = project(tmp_path / "project", "")
    context.file.write_text(context.file.read_text().replace(*change))
    with pytest.raises(StrandcastError, match=words):
        hold(sitting_of(context))


def test_a_sitting_needs_a_keyboard(tmp_path: Path) -> None:
    project(tmp_path / "project", "")
    done = run_module(tmp_path / "project", "strandcast", "throw", NAME)
    assert done.returncode == 2
    assert "SC-X012" in done.stderr


def test_the_page_follows(tmp_path: Path, browser: Browser) -> None:
    terminal = Terminal(tmp_path / "results")
    (tmp_path / "results" / "report.html").write_text("a report")
    with browser.page(terminal.page) as opened:

        def loaded() -> int:
            sent = [
                each["params"]["request"]["url"]
                for each in opened.events
                if each.get("method") == "Network.requestWillBeSent"
            ]
            return sum(url.endswith("report.html") for url in sent)

        terminal.show("waiting for the <film>")
        opened.wait("document.querySelector('p').textContent === 'waiting for the <film>'")
        assert loaded() == 1
        terminal.show_pages("the pages are up to date")
        opened.until(lambda: opened.value("pages") and loaded() == 2, "the report is loaded again")
