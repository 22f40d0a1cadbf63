"""Reading: columns equal laspy's of the source, queries equal masks over all points."""

from __future__ import annotations

import os
import sys
import unittest
from pathlib import Path

import esker
import laspy
import numpy as np
from support import ROOT, Case, as_laspy, creek, fields_of, random_scan, scan

sys.path.insert(0, str(ROOT / "data-format"))


class WholeFiles(Case):
    def test_all_columns_of_the_sample_are_those_of_laspy(self) -> None:
        file, las = creek(), scan()
        points = file.query()
        self.assertEqual((len(points), file.count), (len(las.points), len(las.points)))
        own = points.array()
        self.assertEqual(own.dtype, file.dtype)
        # Fields that Esker has beside these are those of later formats, and zero.
        absent = set(own.dtype.names) - fields_of(las)
        self.assertEqual(absent, {"overlap", "scanner_channel"})
        self.assertFalse(any(own[name].any() for name in absent))
        own = own[[name for name in own.dtype.names if name not in absent]]
        self.assertEqual(fields_of(las), set(own.dtype.names))
        self.assert_same_points(own, as_laspy(las, own.dtype))
        self.assertTrue(np.array_equal(file.scale, las.header.scales))
        self.assertTrue(np.array_equal(file.offset, las.header.offsets))

    def test_all_point_formats_with_extra_bytes_are_those_of_laspy(self) -> None:
        for point_format in (0, 1, 2, 3, 6, 7, 8):
            with self.subTest(point_format=point_format):
                las = random_scan(self.folder / f"{point_format}.laz", point_format)
                out = self.folder / f"{point_format}.esker"
                esker.build(self.folder / f"{point_format}.laz", out)
                points = esker.open(out).query()
                own = points.array()
                missing = fields_of(las) - set(own.dtype.names)
                self.assertEqual(missing, set())
                absent = set(own.dtype.names) - fields_of(las)
                kept = own[[name for name in own.dtype.names if name not in absent]]
                self.assert_same_points(kept, as_laspy(las, kept.dtype))
                for name in absent:
                    self.assertFalse(own[name].any(), name)
                width = np.sort(points.scaled("width"))
                self.assertTrue(np.array_equal(width, np.sort(np.asarray(las["width"]))))

    def test_real_scans_are_those_of_laspy(self) -> None:
        data = os.environ.get("ESKER_DATA")
        if not data:
            self.skipTest("ESKER_DATA is not set")
        compared = 0
        scans = [*Path(data, "las").rglob("*.la[sz]"), *Path(data, "laz").rglob("*.la[sz]")]
        for scan in sorted(scan for scan in scans if scan.stat().st_size < 2_000_000):
            with self.subTest(scan=scan.name):
                try:
                    las = laspy.read(scan)
                except KeyboardInterrupt:
                    raise
                except (
                    BaseException
                ):  # laspy cannot read it; lazrs panics at a missing chunk table.
                    continue
                out = self.folder / "a.esker"
                if esker.build(scan, out, normals="none").points_set_aside:
                    continue
                own = esker.open(out).query().array()
                common = [name for name in own.dtype.names if name in fields_of(las)]
                self.assertLessEqual({"X", "Y", "Z", "intensity", "classification"}, set(common))
                kept = own[common]
                self.assert_same_points(kept, as_laspy(las, kept.dtype))
                compared += 1
        self.assertGreater(compared, 20)

    def test_coordinates_in_doubles_are_those_of_laspy(self) -> None:
        points, las = creek().query(columns=[]), scan()
        self.assertEqual(points.xyz.dtype, np.float64)
        order = np.lexsort((points.X, points.Y, points.Z))
        other = np.lexsort((las.X, las.Y, las.Z))
        self.assertTrue(np.array_equal(points.xyz[order], np.asarray(las.xyz)[other]))
        self.assertTrue(np.array_equal(points["x"], points.x))

    def test_columns_are_not_copies_and_belong_to_the_caller(self) -> None:
        points = creek().query(columns=["gps_time"])
        for column in (points.X, points["gps_time"]):
            self.assertFalse(column.flags.owndata and column.base is not None)
            self.assertTrue(column.flags.c_contiguous and column.flags.aligned)
            self.assertTrue(column.flags.writeable)
        self.assertIs(points["gps_time"], points["GpsTime"])
        points.X[0] = 7
        self.assertEqual(points["X"][0], 7)

    def test_bounds_and_nodes_describe_the_points(self) -> None:
        file = creek()
        points = file.query(columns=[])
        self.assertTrue(np.array_equal(file.bounds[0], points.xyz.min(axis=0)))
        self.assertTrue(np.array_equal(file.bounds[1], points.xyz.max(axis=0)))
        nodes = file.nodes
        self.assertEqual(int(nodes["count"].sum()), file.count)
        self.assertEqual(int((nodes["level"] == 0).sum()), 1)
        for node in nodes[1:]:
            self.assertEqual(node["level"], nodes["level"][node["parent"]] + 1)
        self.assertTrue((nodes["bounds"][:, 0] <= nodes["bounds"][:, 1]).all())
        self.assertTrue((nodes["bounds"][:, 0] >= file.bounds[0]).all())

    def test_points_with_fields_that_some_scans_lack_have_zeros_there(self) -> None:
        las = random_scan(self.folder / "a.las", 3)
        random_scan(self.folder / "b.las", 0)
        out = self.folder / "both.esker"
        esker.build([self.folder / "a.las", self.folder / "b.las"], out)
        points = esker.open(out).query()
        self.assertEqual(len(points), 6000)
        self.assertEqual(np.count_nonzero(points["gps_time"]), np.count_nonzero(las.gps_time))

    def test_trees_of_a_forest_are_read_together(self) -> None:
        forest = esker.open(ROOT / "data-format" / "samples" / "forest-second.esker")
        self.assertEqual(len(forest.query()), forest.count)
        self.assertEqual(len(list(forest.chunks(forest.count // 3))[0]), forest.count // 3)

    def test_a_file_without_points_has_empty_columns(self) -> None:
        file = esker.open(ROOT / "data-format" / "samples" / "empty.esker")
        points = file.query()
        self.assertEqual((len(points), file.count, file.bounds), (0, 0, None))
        self.assertEqual(points.array().dtype, file.dtype)
        self.assertEqual(list(file.chunks(10)), [])


class Queries(Case):
    """Each against a mask over all points."""

    def check(self, mask: np.ndarray, **conditions) -> None:
        all_points = creek().query()
        found = creek().query(**conditions)
        self.assertGreater(mask.sum(), 0)
        self.assertLess(mask.sum(), len(mask))
        self.assert_same_points(found.array(), all_points.array()[mask])

    def test_boxes_hold_the_points_within_their_faces(self) -> None:
        points = creek().query(columns=[])
        (x0, y0, z0), (x1, y1, z1) = creek().bounds
        low, high = (x0 + (x1 - x0) * 0.3, y0), (x0 + (x1 - x0) * 0.6, y0 + (y1 - y0) * 0.5)
        x, y, z = points.x, points.y, points.z
        flat = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1])
        self.check(flat, bounds=(low, high))
        self.check(flat, bounds=(*low, *high))
        middle = (z0 + z1) / 2
        tall = flat & (z >= z0) & (z <= middle)
        self.check(tall, bounds=((*low, z0), (*high, middle)))
        # A face through points: the point itself is in.
        at = points.xyz[1000]
        edge = (x >= x0) & (x <= at[0]) & (y >= y0) & (y <= at[1])
        self.assertTrue(edge[1000])
        self.check(edge, bounds=((x0, y0), (at[0], at[1])))

    def test_polygons_hold_the_points_over_them(self) -> None:
        (x0, y0, _), (x1, y1, _) = creek().bounds
        w, h = x1 - x0, y1 - y0
        # Corners between steps, so that no point lies on an edge, which doubles do not decide.
        ring = [
            (x0 + 0.1 * w + 1 / 3, y0 - 1.0),
            (x1 - 1 / 7, y0 + 0.7 * h),
            (x0 - 1.0, y1 - 1 / 9),
        ]
        hole = [
            (x0 + 0.3 * w, y0 + 0.3 * h + 1 / 7),
            (x0 + 0.5 * w, y0 + 0.35 * h),
            (x0 + 0.3 * w, y0 + 0.6 * h),
        ]
        points = creek().query(columns=[])
        outer, inner = inside(points.x, points.y, ring), inside(points.x, points.y, hole)
        self.check(outer, polygon=ring)
        self.check(outer & ~inner, polygon=[ring, hole])
        words = lambda r: ", ".join(f"{float(x)!r} {float(y)!r}" for x, y in [*r, r[0]])
        self.check(outer & ~inner, polygon=f"POLYGON (({words(ring)}), ({words(hole)}))")
        self.check(outer | inner, polygon=f"MULTIPOLYGON ((({words(ring)})), (({words(hole)})))")
        self.check(outer, polygon={"type": "Polygon", "coordinates": [ring]})
        self.check(outer, polygon=np.array(ring))

    def test_classes_and_values_choose_points(self) -> None:
        points = creek().query()
        classes = points["classification"]
        present = np.unique(classes).tolist()
        self.check(classes == present[0], classes=present[0])
        self.check(np.isin(classes, present[:2]), classes=present[:2])
        self.check(classes == 2, classes="ground")
        self.check(classes == 2, classes=["ground"], columns=None)
        low, high = np.percentile(points["intensity"], [20, 60]).astype(int).tolist()
        within = (points["intensity"] >= low) & (points["intensity"] <= high)
        self.check(within, values={"intensity": (low, high)})
        self.check(points["return_number"] == 2, values={"return_number": 2})
        self.check(points["return_number"] >= 2, values={"return_number": (2, None)})

    def test_conditions_that_are_not_read_as_columns_count_too(self) -> None:
        mask = creek().query()["classification"] == 2
        found = creek().query(classes=2, columns=["intensity"])
        self.assertEqual(list(found), ["X", "Y", "Z", "intensity"])
        wanted = creek().query()["intensity"][mask]
        self.assertTrue(np.array_equal(np.sort(found["intensity"]), np.sort(wanted)))

    def test_a_resolution_takes_the_nodes_that_are_not_finer(self) -> None:
        import reader

        file = creek()
        independent = reader.Esker(file.path)
        nodes = file.nodes
        coarse, fine = float(nodes["spacing"].max()), float(nodes["spacing"].min())
        for spacing in (coarse * 1.5, coarse * 0.9, coarse * 0.4, fine * 1.2):
            rows = []
            for index, node in enumerate(nodes):
                parent = nodes[node["parent"]] if node["level"] else None
                if parent is not None and parent["spacing"] <= spacing:
                    continue
                count = wanted_points(independent, index, float(node["spacing"]), spacing)
                rows.append(lattice_points(independent, index)[:count])
            wanted = np.concatenate(rows)
            found = file.query(resolution=spacing, columns=[])
            self.assertLess(len(found), file.count)
            own = np.stack([found.X, found.Y, found.Z], axis=1).astype(np.int64)
            order = lambda p: p[np.lexsort(p.T)]
            self.assertTrue(np.array_equal(order(own), order(wanted)), spacing)
        self.assertEqual(len(file.query(resolution=1e-6, columns=[])), file.count)

    def test_chunks_are_the_points_of_the_query_in_its_order(self) -> None:
        conditions = {"classes": [2, 5], "columns": ["intensity", "gps_time"]}
        whole = creek().query(**conditions)
        for n in (1, 99_999, 10_000_000):
            chunks = creek().chunks(n, **conditions)
            parts = [next(chunks) for _ in range(100)] if n == 1 else list(chunks)
            self.assertTrue(all(len(part) == n for part in parts[:-1]))
            length = sum(len(part) for part in parts)
            if n > 1:
                self.assertEqual(length, len(whole))
            for name in whole:
                joined = np.concatenate([part[name] for part in parts])
                self.assertTrue(np.array_equal(joined, whole[name][:length]), name)

    def test_only_the_planes_of_the_columns_are_read(self) -> None:
        if not sys.platform.startswith("linux"):
            self.skipTest("reads are counted by the kernel of Linux")

        def read_bytes(**conditions) -> int:
            before = counted()
            creek().query(**conditions)
            return counted() - before

        def counted() -> int:
            with open("/proc/self/io") as file:
                return int(next(line for line in file if line.startswith("rchar")).split()[1])

        everything, nothing = read_bytes(), read_bytes(columns=[])
        size = int(creek().nodes["bytes"].sum())
        self.assertLess(nothing, 0.75 * everything)
        self.assertLess(everything, 1.1 * size)
        low, high = creek().bounds
        corner = (low[:2], low[:2] + (high - low)[:2] * 0.05)
        self.assertLess(read_bytes(bounds=corner), 0.6 * everything)


class Conversions(Case):
    def test_laspy_writes_what_was_read(self) -> None:
        for point_format in (1, 3, 7, 8):
            with self.subTest(point_format=point_format):
                las = random_scan(self.folder / f"{point_format}.las", point_format)
                out = self.folder / f"{point_format}.esker"
                esker.build(self.folder / f"{point_format}.las", out)
                own = esker.open(out).query().to_laspy()
                self.assertEqual(own.point_format.id, point_format)
                own.write(self.folder / "again.laz")
                again = laspy.read(self.folder / "again.laz")
                names = [n for n in las.point_format.dimension_names]
                dtype = np.dtype(
                    [
                        (
                            n,
                            las.points.array[n].dtype
                            if n in ("ratio", "width")
                            else np.asarray(las[n]).dtype,
                        )
                        for n in names
                    ]
                )
                self.assert_same_points(as_laspy(again, dtype), as_laspy(las, dtype))
                self.assertTrue(np.array_equal(again.header.scales, las.header.scales))
                width = again.point_format.dimension_by_name("width")
                self.assertEqual((width.scales[0], width.offsets[0]), (0.5, 1.0))

    def test_reference_systems_in_wkt_are_kept(self) -> None:
        from laspy.vlrs.known import WktCoordinateSystemVlr

        wkt = (
            'PROJCS["local",GEOGCS["GRS80",DATUM["D",SPHEROID["GRS80",6378137,298.257222101]],'
            'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
            'PARAMETER["central_meridian",9],UNIT["metre",1]]'
        )
        las = random_scan(self.folder / "a.las", 6)
        las.header.vlrs.append(WktCoordinateSystemVlr(wkt))
        las.header.global_encoding.wkt = True
        las.write(self.folder / "b.las")
        esker.build(self.folder / "b.las", self.folder / "b.esker")
        file = esker.open(self.folder / "b.esker")
        self.assertEqual((file.crs, file.unit), (wkt, "metre"))
        own = file.query().to_laspy()
        self.assertEqual([v.string for v in own.header.vlrs if v.record_id == 2112], [wkt])

    def test_structured_arrays_have_the_names_of_pdal(self) -> None:
        points = creek().query(resolution=10.0)
        array = points.array("pdal")
        self.assertTrue(np.array_equal(array["X"], points.x))
        self.assertTrue(np.array_equal(array["ReturnNumber"], points["return_number"]))
        self.assertEqual(len(set(array.dtype.names)), len(array.dtype.names))
        with self.assertRaisesRegex(ValueError, "not of 'las'"):
            points.array("las")

    def test_arrow_tables_have_the_columns(self) -> None:
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            with self.assertRaisesRegex(ImportError, "to_arrow needs the package pyarrow"):
                creek().query(resolution=10.0).to_arrow()
            return
        points = creek().query(resolution=10.0)
        table = points.to_arrow()
        self.assertEqual(table.column_names, list(points))
        for name in points:
            self.assertTrue(np.array_equal(table[name].to_numpy(), points[name]), name)

    def test_open3d_clouds_have_coordinates(self) -> None:
        points = creek().query(resolution=10.0)
        try:
            import open3d  # noqa: F401
        except ImportError:
            with self.assertRaisesRegex(ImportError, "to_open3d needs the package open3d"):
                points.to_open3d()
            return
        self.assertTrue(np.array_equal(np.asarray(points.to_open3d().points), points.xyz))


class Arguments(Case):
    def test_wrong_arguments_are_named(self) -> None:
        file = creek()
        for conditions, error, message in (
            ({"columns": ["colour"]}, KeyError, "has no column 'colour'"),
            ({"bounds": (1, 2, 3)}, ValueError, "3 numbers are no box"),
            ({"bounds": ((2, 0), (1, 1))}, ValueError, "least corner first"),
            ({"bounds": ((float("nan"), 0), (1, 1))}, ValueError, "hold nothing"),
            ({"polygon": [(0, 0), (1, 1)]}, ValueError, "at least three corners"),
            ({"polygon": "POLYGON EMPTY"}, ValueError, "neither WKT"),
            ({"polygon": {"type": "Point"}}, ValueError, "not 'Point'"),
            ({"resolution": 0}, ValueError, "above 0"),
            ({"resolution": -1.0}, ValueError, "above 0"),
            ({"classes": "trees"}, ValueError, "is no class"),
            ({"classes": 300}, ValueError, "is no class"),
            ({"classes": []}, ValueError, "numbers or names"),
            ({"values": {"depth": 1}}, esker.EskerError, "no attribute `depth`"),
            ({"flags": "old"}, ValueError, "old"),
        ):
            with self.subTest(conditions=conditions):
                with self.assertRaisesRegex(error, message):
                    file.query(**conditions)
        with self.assertRaisesRegex(ValueError, "never end"):
            file.chunks(0)

    def test_nothing_found_is_no_error(self) -> None:
        found = creek().query(bounds=((0, 0), (1, 1)), columns=["intensity"])
        self.assertEqual(
            (len(found), found["intensity"].dtype, found.xyz.shape), (0, np.uint16, (0, 3))
        )


def inside(x: np.ndarray, y: np.ndarray, ring: list[tuple[float, float]]) -> np.ndarray:
    """Points within a ring, by the even-odd rule."""
    result = np.zeros(len(x), dtype=bool)
    for (ax, ay), (bx, by) in zip(ring, [*ring[1:], ring[0]]):
        crosses = (ay > y) != (by > y)
        with np.errstate(divide="ignore", invalid="ignore"):
            at = ax + (y - ay) / (by - ay) * (bx - ax)
        result ^= crosses & (x < at)
    return result


def lattice_points(independent, index: int) -> np.ndarray:
    """Steps of the points of a node, in their order, as the independent reader decodes them."""
    positions = independent.decode(index, independent.read_page(index))[0]
    return positions.astype(np.int64) - 2**31


def wanted_points(independent, index: int, own: float, wanted: float) -> int:
    """Number of the points of a node that a spacing wants: the fewest whole strata with enough."""
    node = independent.table[index]
    levels = (node["levels"].astype(np.int64) * [1, 256, 65536]).sum(axis=1).tolist()
    dimension = min(max(int(node["shape"]) & 3, 1), 2)
    share = (own / wanted) ** dimension
    if share >= 1:
        return sum(levels)
    points = max(int(np.ceil(sum(levels) * share - 1e-6)), 1)
    have = 0
    for count in levels:
        for stratum in range(16):
            if have >= points:
                return have
            residue = int(f"{stratum:04b}"[::-1], 2)
            have += (count + 15 - residue) // 16
    return have


if __name__ == "__main__":
    unittest.main()
