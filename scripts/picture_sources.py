#!/usr/bin/env python3
"""Checks that the pictures of docs/pictures are as new as the code of their pages.

    scripts/picture_sources.py            compare the code with docs/pictures/sources.json
    scripts/picture_sources.py --write    store the code's hashes, after scripts/make_docs_pictures

The hash of a picture is the SHA-256 of the files that draw its page, without comments, blank lines and tests, so it
needs no git history and a changed comment does not count.
"""

import hashlib
import json
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
STORED = ROOT / "docs/pictures/sources.json"

# Files that draw every page.
COMMON = ["src/report/html.rs", "src/report/chart.rs", "src/report/chart.js", "src/report/page.css"]

# Picture: files and folders that draw its page.
PICTURES = {
    "calibrate": ["src/gap/calibrate_page.rs"],
    "collect": ["src/collect/plan_page.rs"],
    "demo": ["src/demo/page.rs"],
    "eval": ["src/referee/page.rs", "src/referee/page"],
    "fit-actuator": ["src/actuator/page.rs"],
    "fit-actuator-judgement": ["src/actuator/page.rs"],
    "gap": ["src/gap/page.rs", "src/gap/page"],
    "gap-signals": ["src/gap/page.rs", "src/gap/page"],
    "play": ["src/referee/page.rs", "src/referee/page"],
    "sweep": ["src/sweep/page.rs"],
    "train": ["src/train/page.rs"],
    "tune-ekf": ["src/ekf/page.rs"],
}


def code(path: pathlib.Path) -> str:
    """Lines of a file that are code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".rs":
        text = text.split("#[cfg(test)]")[0]
    lines = (line.strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))


def files(sources: list[str]) -> list[pathlib.Path]:
    found = []
    for source in COMMON + sources:
        path = ROOT / source
        inside = path.rglob("*") if path.is_dir() else [path]
        found += [one for one in inside if one.is_file() and one.name != "tests.rs"]
    return sorted(set(found))


def digest(sources: list[str]) -> str:
    sha256 = hashlib.sha256()
    for path in files(sources):
        sha256.update(f"{path.relative_to(ROOT)}\n{code(path)}\n".encode())
    return sha256.hexdigest()


def main() -> None:
    present = {name: sources for name, sources in PICTURES.items() if all((ROOT / one).exists() for one in sources)}
    hashes = {f"{name}.png": digest(sources) for name, sources in present.items()}
    if sys.argv[1:] == ["--write"]:
        STORED.write_text(json.dumps(hashes, indent=2, sort_keys=True) + "\n", encoding="utf-8")
        return
    stored = json.loads(STORED.read_text(encoding="utf-8")) if STORED.exists() else {}
    old = [name for name, value in hashes.items() if stored.get(name) != value]
    if old:
        sys.exit(f"older than the code of their pages: {', '.join(sorted(old))}; run scripts/make_docs_pictures")
    print(f"{len(hashes)} pictures are as new as the code of their pages")


main()
