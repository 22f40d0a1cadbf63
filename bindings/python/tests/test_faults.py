"""Broken files: exceptions with Esker's message, and nothing worse."""

from __future__ import annotations

import os
import unittest
from pathlib import Path

import esker
import numpy as np
from support import ROOT, Case, creek


class Faults(Case):
    def test_the_class_tells_what_is_wrong(self) -> None:
        missing = self.folder / "no.esker"
        with self.assertRaisesRegex(FileNotFoundError, "no.esker: cannot open it") as raised:
            esker.open(missing)
        self.assertEqual(raised.exception.errno, 2)
        for call in (
            lambda: esker.build(missing.with_suffix(".laz"), self.folder / "a.esker"),
            lambda: esker.render(missing),
            lambda: esker.export(missing, self.folder / "a.laz"),
            lambda: esker.verify(missing),
        ):
            with self.assertRaises(FileNotFoundError):
                call()
        with self.assertRaisesRegex(esker.EskerError, "folder"):
            esker.open(self.folder)
        empty = self.folder / "empty.esker"
        empty.write_bytes(b"")
        with self.assertRaisesRegex(esker.EskerError, "empty.esker"):
            esker.open(empty)
        with self.assertRaises(TypeError):
            esker.open(7)
        with self.assertRaisesRegex(OSError, "127.0.0.1"):
            esker.open("http://127.0.0.1:9/town.esker")

    def test_cut_and_flipped_files_raise_or_give_points(self) -> None:
        sample = (ROOT / "data-format" / "samples" / "all-kinds.esker").read_bytes()
        random = np.random.default_rng(5)
        path = self.folder / "a.esker"
        refused = 0
        for turn in range(150):
            data = bytearray(sample)
            if turn % 3 == 0:
                data = data[: random.integers(0, len(data))]
            for _ in range(1 + turn % 4):
                if data:
                    data[random.integers(0, len(data))] ^= 1 << random.integers(0, 8)
            path.write_bytes(data)
            try:
                file = esker.open(path)
                len(file.nodes), file.dtype, file.crs
                file.query()
                list(file.chunks(1000, columns=["intensity"]))
            except (esker.EskerError, OSError) as error:
                refused += 1
                self.assertIn("a.esker", str(error))
            except KeyError:
                pass
        self.assertGreater(refused, 50)

    def test_broken_scans_raise(self) -> None:
        data = os.environ.get("ESKER_DATA")
        if not data:
            self.skipTest("ESKER_DATA is not set")
        for scan in sorted(Path(data, "bad").iterdir()):
            with self.subTest(scan=scan.name):
                try:
                    esker.build(scan, self.folder / "a.esker")
                except (esker.EskerError, OSError) as error:
                    self.assertIn(scan.name, str(error))

    def test_a_file_that_is_cut_while_it_is_read_raises(self) -> None:
        path = self.folder / "a.esker"
        path.write_bytes(Path(creek().path).read_bytes())
        file = esker.open(path)
        os.truncate(path, path.stat().st_size // 3)
        with self.assertRaisesRegex(esker.EskerError, "a.esker"):
            file.query()


if __name__ == "__main__":
    unittest.main()
