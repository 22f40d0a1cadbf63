"""Builds from scans and arrays: nothing is lost, or it is said."""

from __future__ import annotations

import unittest

import esker
import laspy
import numpy as np
from support import SAMPLE, Case, creek, random_scan, scan_path


class FromArrays(Case):
    def test_columns_of_all_types_come_back(self) -> None:
        random = np.random.default_rng(7)
        n = 70_000
        given = {"xyz": random.uniform(-50, 50, (n, 3)).round(3)}
        for kind in ("u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8"):
            limits = np.iinfo(kind)
            given[f"of_{kind}"] = random.integers(
                limits.min, limits.max, n, dtype=kind, endpoint=True
            )
        given["of_f4"] = random.normal(size=n).astype("f4")
        given["of_f8"] = np.where(random.random(n) < 0.01, np.nan, random.normal(size=n))
        given["of_bool"] = random.random(n) < 0.5
        given["swapped"] = np.arange(n).astype(">i4")
        given["strided"] = np.arange(2 * n, dtype="u2")[::2]
        out = self.folder / "a.esker"
        report = esker.build(given, out, scale=0.001)
        self.assertEqual((report.points_in, report.points_out, report.points_refused), (n, n, 0))
        self.assertEqual(report.rounding_error_max, 0.0)
        file = esker.open(out)
        self.assertEqual(file.scale.tolist(), [0.001] * 3)
        points = file.query()
        self.assertEqual(points["of_bool"].dtype, np.uint8)
        steps = np.rint(given["xyz"] / 0.001).astype("i4")
        # Bit by bit, so that NaN counts.
        own = self.rows(
            [points.X, points.Y, points.Z], [points[name] for name in given if name != "xyz"]
        )
        other = self.rows(list(steps.T), [given[name] for name in given if name != "xyz"])
        self.assertTrue(np.array_equal(own, other))
        self.assertTrue(esker.verify(out).ok)

    def rows(self, steps: list, columns: list) -> np.ndarray:
        """Rows as bytes, sorted."""
        all_columns = [
            np.ascontiguousarray(c, dtype=c.dtype.newbyteorder("<")) for c in steps + columns
        ]
        raw = [c.view("u1").reshape(len(c), -1) for c in all_columns]
        joined = np.ascontiguousarray(np.concatenate(raw, axis=1))
        return np.sort(joined.view(f"V{joined.shape[1]}").ravel())

    def test_whole_steps_are_kept_exactly(self) -> None:
        random = np.random.default_rng(3)
        limits = np.iinfo("i4")
        steps = random.integers(limits.min, limits.max, (3, 5000), dtype="i4", endpoint=True)
        grid = {"scale": [0.01, 0.02, 0.001], "offset": [1e6, -7.25, 0.1]}
        out = self.folder / "a.esker"
        report = esker.build({"X": steps[0], "Y": steps[1], "Z": steps[2]}, out, **grid)
        self.assertEqual((report.rounding_error_max, report.points_set_aside), (0.0, 0))
        file = esker.open(out)
        self.assertEqual((file.scale.tolist(), file.offset.tolist()), tuple(grid.values()))
        points = file.query()
        own = np.stack([points.X, points.Y, points.Z])
        self.assertTrue(np.array_equal(own[:, np.lexsort(own)], steps[:, np.lexsort(steps)]))

    def test_coordinates_without_a_scale_choose_one(self) -> None:
        xyz = np.random.default_rng(1).normal(size=(1000, 3)) + [4e5, 5e6, 100]
        report = esker.build(
            {"x": xyz[:, 0], "y": xyz[:, 1], "z": xyz[:, 2]}, self.folder / "a.esker"
        )
        found = esker.open(self.folder / "a.esker").query().xyz
        error = np.abs(found[np.lexsort(found.T)] - xyz[np.lexsort(xyz.T)]).max()
        self.assertLessEqual(error, report.rounding_error_max + 1e-9)
        self.assertLess(report.rounding_error_max, 1e-5)

    def test_far_coordinates_get_an_offset(self) -> None:
        xyz = np.random.default_rng(1).uniform(0, 10, (100, 3)) + 5e9
        esker.build({"xyz": xyz}, self.folder / "a.esker", scale=1e-3)
        file = esker.open(self.folder / "a.esker")
        self.assertEqual(file.offset.tolist(), [5e9 + 5 - o for o in (5e9 + 5 - file.offset)])
        self.assertLess(np.abs(np.sort(file.query().x) - np.sort(xyz[:, 0])).max(), 6e-4)

    def test_points_of_a_query_are_an_input(self) -> None:
        points = creek().query(classes="ground")
        out = self.folder / "ground.esker"
        report = esker.build(points, out)
        self.assertEqual(report.rounding_error_max, 0.0)
        again = esker.open(out)
        self.assertEqual(again.crs, creek().crs)
        self.assert_same_points(again.query().array(), points.array())
        esker.build(points.array(), out, scale=points.scale, offset=points.offset)
        self.assert_same_points(esker.open(out).query().array(), points.array())

    def test_meanings_of_attributes_go_with_points(self) -> None:
        random_scan(self.folder / "a.las", 7)
        esker.build(self.folder / "a.las", self.folder / "a.esker")
        points = esker.open(self.folder / "a.esker").query()
        esker.build(points, self.folder / "b.esker")
        again = esker.open(self.folder / "b.esker")
        self.assertEqual(again.attributes, points.attributes)
        self.assert_same_points(again.query().array(), points.array())

    def test_attributes_with_the_names_of_coordinates_stay_apart(self) -> None:
        scan = self.folder / "scan.ply"
        rows = [f"{i} 0 0 {i % 7} {i % 5} 33" for i in range(40)]
        head = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
        head += [f"property double {axis}" for axis in "xyz"]
        head += ["property float X", "property ushort return_number", "property uchar returns"]
        scan.write_text("\n".join([*head, "end_header", *rows]) + "\n")
        esker.build(scan, self.folder / "a.esker")
        file = esker.open(self.folder / "a.esker")
        points = file.query()
        self.assertEqual(points.array().dtype, file.dtype)
        stored = {a.name for a in file.attributes}
        self.assertEqual(stored, {"X:float32", "return_number:uint16", "returns"})
        self.assertEqual(np.unique(points["X:float32"]).tolist(), [0, 1, 2, 3, 4, 5, 6])
        self.assertEqual(np.unique(points["return_number:uint16"]).tolist(), [0, 1, 2, 3, 4])
        self.assertEqual(np.unique(points["return_number"]).tolist(), [1])
        only = file.query(columns=["X:float32", "return_number:uint16"])
        self.assertEqual(list(only), ["X", "Y", "Z", "X:float32", "return_number:uint16"])

    def test_bit_fields_are_packed_and_colours_split(self) -> None:
        n = 100
        given = {
            "xyz": np.random.default_rng(2).random((n, 3)),
            "ReturnNumber": np.arange(n) % 5 + 1,
            "NumberOfReturns": np.full(n, 5),
            "withheld": np.arange(n) % 2 == 0,
            "Classification": np.full(n, 6),
            "rgb": np.random.default_rng(2).integers(0, 65535, (n, 3)),
            "normals": np.tile([0.0, 0.0, 1.0], (n, 1)),
        }
        esker.build(given, self.folder / "a.esker")
        points = esker.open(self.folder / "a.esker").query()
        self.assertEqual(np.bincount(points["return_number"]).tolist(), [0, 20, 20, 20, 20, 20])
        self.assertEqual(int(points["withheld"].sum()), 50)
        self.assertEqual(
            (points["classification"].dtype, points["red"].dtype), (np.uint8, np.uint16)
        )
        self.assertTrue(np.array_equal(np.sort(points["blue"]), np.sort(given["rgb"][:, 2])))
        self.assertEqual(points["nz"].dtype, np.float32)

    def test_what_cannot_be_kept_is_refused_by_name(self) -> None:
        xyz = np.random.default_rng(1).random((50, 3))
        bad = xyz.copy()
        bad[33, 1] = np.inf
        for given, options, error, message in (
            ({"xyz": bad}, {}, esker.EskerError, r"row 33 is at \[.*inf.*\], which is no place"),
            ({"xyz": bad}, {"scale": 0.01}, esker.EskerError, "row 33"),
            (
                {"xyz": xyz, "a": np.zeros(49)},
                {},
                ValueError,
                "a has the shape .49,., and there are 50",
            ),
            ({"xyz": xyz, "a": np.zeros(50, "c16")}, {}, TypeError, "a: values of complex128"),
            ({"xyz": xyz, "a": np.array(["x"] * 50)}, {}, TypeError, "a: values of <U1"),
            ({"xyz": xyz, "return_number": np.full(50, 16)}, {}, ValueError, "from 0 to 15"),
            ({"xyz": xyz[:, :2]}, {}, ValueError, "N x 3"),
            ({"a": np.zeros(5)}, {}, ValueError, "coordinates are missing"),
            ({"x": xyz[:, 0]}, {}, ValueError, "x, y and z"),
            (
                {"X": np.zeros(2, int), "Y": np.zeros(2, int), "Z": np.zeros(2, int)},
                {},
                ValueError,
                "scale and offset",
            ),
            ({"xyz": xyz}, {"scale": 0}, ValueError, "no length"),
            (
                {"xyz": xyz * 1e9},
                {"scale": 1e-3, "offset": 0.0},
                esker.EskerError,
                "choose a greater scale",
            ),
            ({"xyz": xyz}, {"normals": "best"}, ValueError, "not best"),
            ({"xyz": xyz}, {"memory": "much"}, ValueError, "memory"),
            ({"xyz": xyz}, {"colour": 3}, ValueError, "no option colour"),
            (xyz, {}, TypeError, "named columns"),
        ):
            with self.subTest(message=message), self.assertRaisesRegex(error, message):
                esker.build(given, self.folder / "a.esker", **options)
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_no_points_are_a_file_without_points(self) -> None:
        esker.build({"xyz": np.empty((0, 3))}, self.folder / "a.esker")
        self.assertEqual(esker.open(self.folder / "a.esker").count, 0)


class FromScans(Case):
    def test_a_report_counts_and_progress_is_called(self) -> None:
        seen: list[esker.Progress] = []
        report = esker.build(
            str(SAMPLE), self.folder / "a.esker", progress=seen.append, memory="1GiB"
        )
        self.assertEqual(report.points_in, report.points_out)
        self.assertEqual(report.as_dict()["points_in"], laspy.read(SAMPLE).header.point_count)
        self.assertGreater(len(seen), 0)
        self.assertTrue(all(isinstance(p, esker.Progress) and p.phase for p in seen))
        with self.assertRaisesRegex(AttributeError, "points_in"):
            report.points

    def test_an_exception_of_the_callback_stops_the_build(self) -> None:
        class Enough(Exception):
            pass

        def stop(progress: esker.Progress) -> None:
            raise Enough

        with self.assertRaises(Enough):
            esker.build("synthetic:terrain:20M:1", self.folder / "a.esker", progress=stop)
        self.assertEqual([p.name for p in self.folder.iterdir()], [])

    def test_loss_is_an_exception_unless_it_is_allowed(self) -> None:
        scan = self.folder / "scan.xyz"
        rows = [f"{i} {i * 0.5} {i * 0.25}" for i in range(50)]
        rows[20] = "nan 1 2"
        scan.write_text("\n".join(rows))
        out = self.folder / "a.esker"
        with self.assertRaisesRegex(
            esker.LossError, "1 points were refused, so nothing was written.*allow_loss=True"
        ):
            esker.build(scan, out)
        self.assertFalse(out.exists())
        report = esker.build(scan, out, allow_loss=True)
        self.assertEqual((report.points_out, report.points_refused), (49, 1))
        self.assertTrue(issubclass(esker.LossError, esker.EskerError))

    def test_exports_and_verification_go_round(self) -> None:
        report = esker.export(creek(), self.folder / "all.laz")
        self.assertTrue(report.hash_equal)
        self.assertTrue(esker.verify(self.folder / "all.laz", against=creek().path).ok)
        self.assertTrue(creek().verify(against=[scan_path()]).ok)
        with self.assertRaisesRegex(esker.EskerError, "is there already"):
            creek().export(self.folder / "all.laz")
        part = creek().export(self.folder / "all.laz", classes="ground", overwrite=True)
        self.assertEqual(part.points_out, len(creek().query(classes="ground", columns=[])))
        creek().export(self.folder / "part.copc.laz", resolution=1.0)
        random_scan(self.folder / "other.las", 3)
        with self.assertRaises(esker.EskerError):
            creek().verify(against=self.folder / "other.las")


if __name__ == "__main__":
    unittest.main()
