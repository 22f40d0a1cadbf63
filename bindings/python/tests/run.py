"""Runs all tests and the examples of the documentation; prints sums as `cargo test` does.

Takes the installed package `esker`, laspy and lazrs. `ESKER_PROGRAM` names the program `esker`,
whose pictures are compared. With words, runs only tests whose names have one of them.
"""

from __future__ import annotations

import doctest
import os
import re
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

import esker
import esker.jobs
import numpy as np
from support import write_scan

HERE = Path(__file__).resolve().parent
MODULES = ("", "._build", "._file", "._filter", "._names", "._picture", "._points", ".jobs")
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def examples() -> unittest.TestSuite:
    """Examples of the docstrings, and of `docs/python.md`, in a folder with the sample scan."""
    suite = unittest.TestSuite()
    names = {"esker": esker, "np": np}

    def begin(test: doctest.DocTest) -> None:
        test.globs["points"] = esker.open("creek.esker").query(columns=["returns", "gps_time"])

    for name in MODULES:
        module = sys.modules[f"esker{name}"]
        try:
            found = doctest.DocTestSuite(module, extraglobs=names, optionflags=FLAGS, setUp=begin)
        except ValueError:
            continue
        suite.addTests(found)
    guide = HERE.parents[2] / "docs" / "python.md"
    text = guide.read_text(encoding="utf-8")
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    parser = doctest.DocTestParser()
    test = parser.get_doctest("\n".join(blocks), dict(names), guide.name, str(guide), 0)
    suite.addTest(doctest.DocTestCase(test, optionflags=FLAGS))
    return suite


def flat(suite: unittest.TestSuite) -> list[unittest.TestCase]:
    """All tests of a suite."""
    found: list[unittest.TestCase] = []
    for test in suite:
        found.extend(flat(test) if isinstance(test, unittest.TestSuite) else [test])
    return found


def main(words: list[str]) -> int:
    """Runs the tests; the exit code."""
    tests = flat(unittest.defaultTestLoader.discover(str(HERE)))
    folder = tempfile.mkdtemp(prefix="esker-python-examples-")
    # What is fetched from servers is not kept.
    os.environ["XDG_CACHE_HOME"] = folder
    os.chdir(folder)
    write_scan(Path("creek.laz"))
    esker.build("creek.laz", "creek.esker")
    tests += flat(examples())
    chosen = [t for t in tests if not words or any(word in t.id() for word in words)]
    result = unittest.TextTestRunner(stream=sys.stdout, verbosity=2).run(unittest.TestSuite(chosen))
    os.chdir(HERE)
    shutil.rmtree(folder)
    failed = len({id(t) for t, _ in result.failures + result.errors})
    skipped = len(result.skipped)
    passed = result.testsRun - failed - skipped
    word = "ok" if result.wasSuccessful() else "FAILED"
    print(f"test result: {word}. {passed} passed; {failed} failed; {skipped} ignored")
    return 0 if result.wasSuccessful() and passed else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
