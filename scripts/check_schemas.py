#!/usr/bin/env python3
"""Validates result documents against the JSON Schemas that `klasktron schema` prints.

    scripts/check_schemas.py FOLDER DOCUMENT...

FOLDER holds gap.schema.json and the others; each DOCUMENT is a path in it, such as ekf/ekf.json. A document that was
not written is an error, except twin.json.
"""

import json
import sys
from pathlib import Path

import jsonschema


def main():
    """Validates every document and prints one line for each."""
    folder, documents = Path(sys.argv[1]), sys.argv[2:]
    faults = 0
    for name in documents:
        path = folder / name
        if not path.exists() and path.name == "twin.json":
            print(f"{name}: not written")
            continue
        schema = json.loads((folder / f"{path.stem}.schema.json").read_text())
        jsonschema.Draft202012Validator.check_schema(schema)
        validator = jsonschema.Draft202012Validator(schema)
        errors = list(validator.iter_errors(json.loads(path.read_text())))
        for error in errors:
            place = "/".join(map(str, error.absolute_path))
            print(f"{name}: {place}: {error.message}", file=sys.stderr)
        faults += len(errors)
        print(f"{name}: {'valid' if not errors else f'{len(errors)} errors'}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
