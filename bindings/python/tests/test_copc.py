"""COPC files are opened as they are: points, queries and pictures equal those of laspy's reading."""

from __future__ import annotations

import unittest
from pathlib import Path

import esker
import laspy
import numpy as np
from support import Case, as_laspy, creek, fields_of, shared_folder

WKT = 'LOCAL_CS["site",UNIT["metre",1]]'


def copc_path() -> Path:
    """The shared scan as COPC."""
    path = shared_folder() / "creek.copc.laz"
    if not path.exists():
        esker.export(creek(), path, crs=WKT)
    return path


class Copc(Case):
    def test_all_columns_are_those_of_laspy(self) -> None:
        file, las = esker.open(copc_path()), laspy.read(copc_path())
        points = file.query()
        self.assertEqual((file.count, len(points)), (len(las.points), len(las.points)))
        own = points.array()
        own = own[[name for name in own.dtype.names if name in fields_of(las)]]
        self.assert_same_points(own, as_laspy(las, own.dtype))
        self.assertTrue(np.array_equal(file.scale, las.header.scales))
        self.assertTrue(np.array_equal(file.offset, las.header.offsets))
        self.assertEqual(int(file.nodes["count"].sum()), file.count)
        self.assertTrue(np.allclose(file.bounds, [las.header.mins, las.header.maxs], atol=1e-9))

    def test_a_box_has_the_points_of_a_mask(self) -> None:
        file = esker.open(copc_path())
        las = laspy.read(copc_path())
        xyz = np.asarray(las.xyz)
        low, high = (np.quantile(xyz, share, axis=0) for share in (0.3, 0.6))
        for box in ((low[:2], high[:2]), (low, high), (xyz[17], xyz[17])):
            found = file.query(bounds=box, columns=["intensity"])
            axes = len(box[0])
            mask = ((xyz[:, :axes] >= box[0]) & (xyz[:, :axes] <= box[1])).all(axis=1)
            self.assertEqual(len(found), int(mask.sum()))
            self.assertGreater(len(found), 0)
            sums = (found["intensity"].sum(dtype=np.int64), found.Z.sum(dtype=np.int64))
            want = (las.intensity[mask].sum(dtype=np.int64), las.Z[mask].sum(dtype=np.int64))
            self.assertEqual(sums, want)

    def test_chunks_and_pictures_are_those_of_the_whole(self) -> None:
        file = esker.open(copc_path())
        lengths = [len(chunk) for chunk in file.chunks(100_000, columns=[])]
        self.assertEqual(sum(lengths), file.count)
        picture = esker.render(file, size=(160, 120))
        self.assertEqual(np.asarray(picture).shape, (120, 160, 4))
        self.assertGreater(np.asarray(picture)[..., :3].std(), 5)


if __name__ == "__main__":
    unittest.main()
