"""A panel of a page: its declaration, the content that its function returns, and its section on the page."""

import logging
from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from markupsafe import Markup

from strandcast.errors import StrandcastError
from strandcast.report.drawing import Drawing, drawing, to_svg
from strandcast.report.results import ABSENT, FILES, OPTIONAL

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Table:
    """A small table: heads and rows of text; cells may be markup."""

    heads: list[str]
    rows: list[list[Any]]
    caption: str = ""


@dataclass(frozen=True)
class PanelContent:
    """The content of a panel, as its function returns it."""

    finding: str  # one sentence with numbers, computed from the data
    drawing: Drawing | Markup | None = None
    tables: list[Table] = field(default_factory=list)
    sources: list[str] = field(default_factory=list)  # files it was made from, relative to the page
    # These replace the panel's.
    title: str | None = None
    caption: str | None = None
    good: str | None = None


@dataclass(frozen=True)
class Panel:
    """One panel, as a page declares it; `Any` is the page's data (`TrialPageData`, `ExperimentPageData`)."""

    name: str  # also its anchor, unique on the page
    title: str
    build: Callable[[Any], PanelContent]
    needs: tuple[str, ...] = ()  # required results, by the names of `report.results.FILES`
    caption: str = ""  # what is drawn, and how
    good: str = ""  # how good data look in this panel
    bad: str = ""  # how bad data look, and why
    shown: Callable[[Any], bool] = lambda page: True  # whether a page has this panel at all
    leads: bool = False  # whether it may stand beside the verdict
    open: bool = False  # whether it is unfolded at first


@dataclass(frozen=True)
class PageSection:
    """A panel on a page: its content, or the problem that prevented it."""

    panel: Panel
    content: PanelContent
    markup: Markup = field(default_factory=Markup)
    problem: str | None = None
    optional: bool = False  # whether the problem is a file that a complete trial may lack
    open: bool = False  # whether it is unfolded at first

    @property
    def name(self) -> str:
        """Return the panel's name, the section's anchor."""
        return self.panel.name

    @property
    def title(self) -> str:
        """Return the content's title, or else the panel's."""
        return self.content.title or self.panel.title


def make_section(panel: Panel, page: Any) -> PageSection:
    """Return a panel's section; an error in its function becomes its problem, and the page stays complete."""
    try:
        for name in panel.needs:
            page.need(name)
        with drawing():
            made = panel.build(page)
            shape = made.drawing
            markup = to_svg(shape, panel.name) if isinstance(shape, Drawing) else shape or Markup()
    except StrandcastError as problem:
        optional = ABSENT in problem.what and _is_optional(page, Path(problem.file or "").name)
        if optional:
            problem.fix = (
                "none needed: only this figure needs the file, everything else is complete without it"
            )
        return PageSection(panel, PanelContent(""), problem=problem.message(), optional=optional)
    except Exception as problem:
        log.warning("panel %r failed", panel.name, exc_info=log.isEnabledFor(logging.DEBUG))
        text = StrandcastError("SC-H002", f"{type(problem).__name__}: {problem}").message()
        return PageSection(panel, PanelContent(""), problem=text)
    return PageSection(panel, made, markup)


def _is_optional(page: Any, file: str) -> bool:
    """Return whether what a page shows is complete without a file."""
    names = page.results.not_made() if hasattr(page, "results") else OPTIONAL
    return file in {Path(FILES[name]).name for name in names}


def make_sections(panels: list[Panel], page: Any, unfolded: Collection[str] = ()) -> list[PageSection]:
    """Return the sections of all panels that the page has; `unfolded` names more of them to unfold."""
    made = (make_section(panel, page) for panel in panels if panel.shown(page))
    return [replace(it, open=it.panel.open or it.problem is not None or it.name in unfolded) for it in made]


def without_lead(sections: list[PageSection]) -> tuple[PageSection | None, list[PageSection]]:
    """Return the section that stands beside the verdict, if one can, and the others."""
    lead = next((each for each in sections if each.panel.leads and each.problem is None), None)
    return lead, [each for each in sections if each is not lead]
