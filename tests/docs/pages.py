"""What the documentation says: its pages, their blocks of commands, and the commands in their text."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[2]
PAGES = (
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "config/README.md")),
    *sorted(set((ROOT / "docs").rglob("*.md")) - {ROOT / "docs/reference/commands.md"}),  # made from them
)
ROBOT = "<!-- robot -->"  # the next block needs a robot, its log or its video
PROGRAMS = ("strandcast", "make", "snakemake", "python")
BLOCK = re.compile(
    rf"(?P<robot>{ROBOT}\n+)?"
    r"(?:^```(?P<tag>\w*)\n(?P<fenced>.*?)^```"
    r"|(?P<indented>(?:^    [^\n]*\n(?:^ *\n(?=    ))*)+))",
    re.MULTILINE | re.DOTALL,
)


class Command(NamedTuple):
    """One line of a block: the page's path, the words, and whether it needs a robot."""

    page: str
    words: tuple[str, ...]
    robot: bool

    def __str__(self) -> str:
        return f"{self.page}: {' '.join(self.words)}"


def blocks(page: Path) -> Iterator[tuple[str, bool]]:
    """Yield the blocks of a page that a shell could run, and whether each needs a robot."""
    for found in BLOCK.finditer(page.read_text(encoding="utf-8")):
        if found["fenced"] is not None and found["tag"] in ("", "sh", "bash"):
            yield found["fenced"], bool(found["robot"])
        elif found["indented"] is not None:
            yield re.sub("^    ", "", found["indented"], flags=re.MULTILINE), bool(found["robot"])


def commands_of(text: str) -> Iterator[tuple[str, ...]]:
    """Yield the words of each line that runs one of our programs; comments and redirections are left out."""
    for line in text.replace("\\\n", " ").splitlines():
        if line.strip().split(" ")[0] in PROGRAMS:
            words = shlex.split(line, comments=True)
            yield tuple(words[: words.index(">")] if ">" in words else words)


def block_commands() -> list[Command]:
    """Return every command in a block of a page."""
    return [
        Command(str(page.relative_to(ROOT)), words, robot)
        for page in PAGES
        for text, robot in blocks(page)
        for words in commands_of(text)
        if words[1:2] not in (("is",), ("changes.",))
    ]


def inline_commands() -> list[Command]:
    """Return every command in the text of a page, between backticks."""
    return [
        Command(str(page.relative_to(ROOT)), words, False)
        for page in PAGES
        for quoted in re.findall(r"`([^`\n]+)`", page.read_text(encoding="utf-8"))
        for words in commands_of(quoted)
        if len(words) > 1
    ]
