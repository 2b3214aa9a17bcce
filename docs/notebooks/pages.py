"""A hook of MkDocs: each notebook is a page of the site, with its links checked, and a file to download."""

import json
import shutil
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page


class Notebook(File):
    """A notebook among the files of the site."""

    def is_documentation_page(self) -> bool:
        """Return True: MkDocs itself makes pages of Markdown files only."""
        return True


def on_files(files: Files, config: MkDocsConfig) -> None:
    """Let the notebooks be pages."""
    for file in [each for each in files if each.src_uri.endswith(".ipynb")]:
        files.remove(file)
        files.append(Notebook(file.src_uri, config.docs_dir, config.site_dir, config.use_directory_urls))


def on_page_read_source(page: Page, config: MkDocsConfig) -> str | None:
    """Return the Markdown of a notebook: its text, and its code in blocks."""
    if not isinstance(page.file, Notebook):
        return None
    cells = [
        (cell["cell_type"], "".join(cell["source"])) for cell in json.loads(page.file.content_string)["cells"]
    ]
    blocks = [text if kind == "markdown" else f"```python\n{text}\n```" for kind, text in cells]
    name = Path(page.file.src_uri).name
    title, _, rest = blocks[0].partition("\n")
    return "\n\n".join(
        [title, f'<a href="{name}" download>Download this notebook: {name}</a>', rest, *blocks[1:]]
    )


def on_post_build(config: MkDocsConfig) -> None:
    """Put the notebooks beside their pages."""
    for notebook in Path(config.docs_dir).rglob("*.ipynb"):
        shutil.copy(notebook, Path(config.site_dir) / notebook.relative_to(config.docs_dir))
