"""Navigation of the site: the links in docs/README.md, in their order, under their headings.

A hook of MkDocs (mkdocs.yml). docs/README.md is the only list of pages, for readers of the Markdown and of the site alike.
"""

import re
from pathlib import Path

LINK = re.compile(r"\[([^\]]+)\]\(([^)#/]+\.md)\)")


def navigation(index):
    """Entries of the navigation for the text of docs/README.md."""
    entries, section, seen = [{"Overview": "README.md"}], None, set()
    for line in index.splitlines():
        if line.startswith("## "):
            section = []
            entries.append({line[3:].strip(): section})
        for text, page in LINK.findall(line):
            if page not in seen:
                seen.add(page)
                title = text.strip("`")
                (entries if section is None else section).append({title[0].upper() + title[1:] if " " in title else title: page})
    return [entry for entry in entries if list(entry.values())[0]]


def on_config(config):
    """Set the navigation before MkDocs reads the pages."""
    index = Path(config.docs_dir) / "README.md"
    config.nav = navigation(index.read_text(encoding="utf-8"))
    return config
