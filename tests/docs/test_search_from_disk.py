"""The site's search runs in a worker, which a page that was opened from the disk may not start."""

from pathlib import Path

import pytest
from tests.report.chromium import Browser

WORKER = "addEventListener('message', event => postMessage(event.data.map(word => word.toUpperCase())));"
ASK = """new Promise((resolve, reject) => {
    const worker = new Worker(new URL('worker.js', location));
    worker.addEventListener('message', event => resolve(event.data));
    worker.addEventListener('error', () => resolve('refused'));
    worker.postMessage(['string', 'tip']);
})"""


@pytest.mark.parametrize(("head", "answer"), [("", "refused"), ("iframe-worker.js", ["STRING", "TIP"])])
def test_a_worker_answers_on_a_page_from_the_disk(
    head: str, answer: object, tmp_path: Path, project_root: Path, browser: Browser
) -> None:
    (tmp_path / "worker.js").write_text(WORKER)
    (tmp_path / "iframe-worker.js").write_text((project_root / "docs/iframe-worker.js").read_text())
    script = f'<script src="{head}"></script>' if head else ""
    (tmp_path / "page.html").write_text(f"<!doctype html><head>{script}</head><body></body>")
    with browser.page(tmp_path / "page.html") as opened:
        assert opened.value(f"{ASK}.catch(() => 'refused')") == answer
