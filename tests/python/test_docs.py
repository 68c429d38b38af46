"""The Python code of the documentation runs as it stands."""

import re

import pytest
from conftest import ROOT

PAGES = sorted((ROOT / "docs").glob("*.md"))


def code(page):
    """The Python blocks of a page, which build on each other; none where they are of other packages."""
    blocks = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    return blocks if any("klasktron" in block for block in blocks) else []


@pytest.mark.parametrize("page", [page for page in PAGES if code(page)], ids=lambda page: page.stem)
def test_the_code_of_the_page_runs(page, monkeypatch):
    if "klasktron.envs" in page.read_text(encoding="utf-8"):
        pytest.importorskip("gymnasium")
    monkeypatch.chdir(ROOT)
    names = {"__name__": "docs"}
    for block in code(page):
        exec(compile(block, str(page), "exec"), names)


def test_a_page_has_python_code():
    assert any(code(page) for page in PAGES)
