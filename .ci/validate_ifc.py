#!/usr/bin/env python3
"""Validates IFC files against their schema, express rules included: exit 0 only when there is nothing to say.

    .ci/validate_ifc.py              the models that the generators write, and the files in fixtures/data
    .ci/validate_ifc.py FILE.ifc …   these files

Needs `pip install ifcopenshell pytest numpy` (the express rules need pytest) and, without arguments, cargo.
"""

import pathlib
import subprocess
import sys
import tempfile

import ifcopenshell.validate

ROOT = pathlib.Path(__file__).resolve().parent.parent
GENERATED = [["quarter-circle"], ["quarter-circle", "--layers", "1", "--seed", "7", "--layer-time", "92.5"]]


def generate(folder):
    """Writes each generated model to a file of its own."""
    for number, arguments in enumerate(GENERATED):
        path = folder / f"{'_'.join(arguments)}.ifc"
        command = ["cargo", "run", "--quiet", "--locked", "-p", "screed-fixtures", "--", *arguments]
        with path.open("wb") as out:
            subprocess.run(command, cwd=ROOT, stdout=out, check=True)
        yield path


def issues(path):
    """Everything that the validator says about a file."""
    logger = ifcopenshell.validate.json_logger()
    ifcopenshell.validate.validate(str(path), logger, express_rules=True)
    return logger.statements


def main(arguments):
    with tempfile.TemporaryDirectory() as folder:
        paths = [pathlib.Path(argument) for argument in arguments]
        if not paths:
            paths = [*generate(pathlib.Path(folder)), *sorted((ROOT / "fixtures" / "data").glob("*.ifc"))]
        failed = 0
        for path in paths:
            found = issues(path)
            failed += bool(found)
            print(f"{path.name}: {len(found)} issues")
            for statement in found:
                print(f"  {statement.get('level', '?')}: {statement.get('message', statement)}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
