"""The installed manual: its pages, and what each error code means."""

import difflib
import json
import re
from typing import Annotated

import typer

from strandcast.cli.common import AsJson, show
from strandcast.errors import StrandcastError

SCHEMA = "schema"  # a page made from the settings
INCLUDED = re.compile(r'^--8<-- "(.+)"\n', re.MULTILINE)


def explain(
    code: Annotated[str, typer.Argument(metavar="CODE", help="As a message begins with, e.g. SC-A012.")],
    as_json: AsJson = False,
) -> None:
    """Print what an error code means, and what to do."""
    from strandcast.errors.registry import merged_codes, read_codes

    _, codes = read_codes()
    name = next(iter(re.findall(r"SC-[A-Z]\d{3}", f"SC-{code} {code}".upper())), "")
    name = merged_codes().get(name, name)
    if name not in codes:
        raise StrandcastError(
            "SC-W021", f"there is no error code {code!r}", fix="`strandcast docs errors` lists all"
        )
    found = codes[name]
    cause = [found.cause, ""] if found.cause else []
    lines = [f"{found.code}: {found.title}", "", *cause, f"Fix: {found.fix}"]
    show(as_json, found._asdict(), lines)


def docs(
    page: Annotated[
        str | None,
        typer.Argument(metavar="PAGE", help="E.g. tutorial, or how-to/install.  [default: list all]"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print a page of the manual, or list all; schema: the JSON schema of experiment.yaml, for editors."""
    if page == SCHEMA:
        from strandcast.config.schema import json_schema

        text = json_schema()
        show(as_json, json.loads(text), text.splitlines())
        return
    from strandcast.workflow.project import shipped

    folder = shipped() / "docs"
    pages = {
        path.relative_to(folder).with_suffix("").as_posix(): path.read_text(encoding="utf-8")
        for path in sorted(folder.rglob("*.md"))
    }
    if page is None:
        titles = {name: text.partition("\n")[0].lstrip("# ") for name, text in pages.items()}
        lines = [f"The manual is in {folder}. Print a page, or the docs/… of a message: strandcast docs PAGE"]
        lines += [f"  {name:44} {title}" for name, title in titles.items()]
        show(as_json, {"folder": str(folder), "pages": titles}, lines)
        return
    wanted = page.partition("#")[0].removeprefix("docs/").removesuffix(".md")
    if wanted not in pages:
        near = difflib.get_close_matches(wanted, pages, n=1)
        fix = f"did you mean {near[0]}?" if near else "`strandcast docs` lists the pages"
        raise StrandcastError("SC-W021", f"the manual has no page {page!r}", fix=fix)
    # A file that the site includes, e.g. the arm's.
    text = re.sub(INCLUDED, lambda found: (shipped() / found[1]).read_text(encoding="utf-8"), pages[wanted])
    show(as_json, {"page": wanted, "text": text}, [text])
