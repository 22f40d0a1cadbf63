"""Pictures equal those of the program `esker render`."""

from __future__ import annotations

import subprocess
import unittest

import esker
import numpy as np
from support import Case, creek, esker_program


class Pictures(Case):
    def test_pictures_are_those_of_the_program(self) -> None:
        program = esker_program()
        if program is None:
            self.skipTest("ESKER_PROGRAM does not name the program esker")
        for method in ("auto", "points", "ewa"):
            for arguments, options in (
                ((), {}),
                (
                    ("--colour", "elevation", "--classes", "2,5"),
                    {"colour": "elevation", "classes": [2, 5]},
                ),
            ):
                with self.subTest(method=method, options=options):
                    out = self.folder / "p.png"
                    line = [program, "render", creek().path, "-o", out, "--size", "320x200"]
                    line += ["--backend", "cpu", "--method", method, *arguments]
                    subprocess.run(line, check=True, capture_output=True)
                    own = creek().render(size=(320, 200), backend="cpu", method=method, **options)
                    self.assertEqual(own.png(), out.read_bytes())

    def test_a_picture_is_an_array_that_notebooks_show(self) -> None:
        picture = esker.render(creek(), size=(80, 60), backend="cpu")
        self.assertIsInstance(picture, np.ndarray)
        self.assertEqual((picture.shape, picture.dtype), ((60, 80, 4), np.uint8))
        self.assertEqual(picture._repr_png_(), picture.png())
        self.assertIsNone(picture[0]._repr_png_())
        self.assertEqual((picture.report.width, picture.report.height), (80, 60))
        half = picture[:30]
        self.assertEqual(half.report.width, 80)
        half.save(self.folder / "half.png")
        self.assertEqual((self.folder / "half.png").read_bytes(), half.png())
        with self.assertRaisesRegex(ValueError, "height x width x 4"):
            picture[..., 0].png()

    def test_depth_is_finite_exactly_where_something_is_drawn(self) -> None:
        both = esker.render(creek(), size=(160, 100), backend="cpu", outputs=("depth",))
        depth = both["depth"]
        self.assertEqual((depth.shape, depth.dtype), ((100, 160), np.float32))
        report = both["colour"].report
        self.assertEqual(int(np.isfinite(depth).sum()), report.pixels_covered)
        self.assertGreater(depth[np.isfinite(depth)].min(), 0)

    def test_indices_are_points_that_lie_in_their_pixels(self) -> None:
        low, high = creek().bounds
        size = np.array([160, 120])
        height = float((high - low)[1])
        camera = {
            "eye": ((low + high) / 2)[:2].tolist() + [float(high[2]) + 100.0],
            "direction": (0, 0, -1),
            "up": (0, 1, 0),
            "ortho": height,
        }
        images = creek().render(
            size=tuple(size.tolist()), camera=camera, backend="cpu", outputs=("index", "depth")
        )
        index, depth = images["index"], images["depth"]
        rows, columns = np.nonzero(index["node"] != esker.NO_NODE)
        self.assertGreater(len(rows), 1000)
        points = creek().at(index, columns=["intensity"])
        self.assertEqual(len(points), len(rows))
        pixel = height / size[1]
        centre = (low + high)[:2] / 2
        right = (points.x - centre[0]) / pixel + size[0] / 2
        down = (centre[1] - points.y) / pixel + size[1] / 2
        # Drawn positions have a few bits fewer where that is not seen.
        self.assertLess(np.abs(right - columns - 0.5).max(), 0.6)
        self.assertLess(np.abs(down - rows - 0.5).max(), 0.6)
        behind = (float(high[2]) + 100.0 - points.z) - depth[rows, columns]
        self.assertLess(behind.max(), 3 * pixel)
        self.assertEqual(points["intensity"].dtype, np.uint16)
        again = creek().at(index[index["node"] != esker.NO_NODE][::-1], columns=[])
        self.assertTrue(np.array_equal(again.X[::-1], points.X))
        wrong = np.array([(0, 2**31)], index.dtype)
        with self.assertRaisesRegex(esker.EskerError, "node 0 has no point 2147483648"):
            creek().at(wrong)

    def test_normals_are_those_of_the_shown_surface(self) -> None:
        # A plane that rises by 1 along x and by 2 along y.
        x, y = np.meshgrid(np.arange(0, 20, 0.05), np.arange(0, 20, 0.05))
        plane = np.stack([x, y, x + 2 * y], axis=-1).reshape(-1, 3)
        path = self.folder / "plane.esker"
        esker.build({"xyz": plane}, path, scale=0.001)
        images = esker.render(
            path,
            size=(90, 90),
            backend="cpu",
            outputs="normal",
            camera={"eye": (10, -10, 60), "target": (10, 10, 30)},
        )
        normal = images["normal"].reshape(-1, 3)
        normal = normal[np.isfinite(normal[:, 0])]
        self.assertGreater(len(normal), 500)
        self.assertLess(np.abs(np.linalg.norm(normal, axis=1) - 1).max(), 1e-5)
        wanted = np.array([-1, -2, 1]) / np.sqrt(6)
        # Silhouettes aside.
        self.assertGreater(np.median(normal @ wanted), 0.99)
        drawn = images["colour"].report.pixels_covered
        self.assertEqual(int(np.isfinite(images["normal"]).all(axis=2).sum()), drawn)

    def test_layers_of_a_window_are_parts_of_those_of_the_picture(self) -> None:
        outputs = ("depth", "index")
        whole = creek().render(size=(96, 64), backend="cpu", method="points", outputs=outputs)
        part = creek().render(
            size=(96, 64), backend="cpu", method="points", outputs=outputs, window="20,10,30,24"
        )
        for name in outputs:
            self.assertTrue(np.array_equal(part[name], whole[name][10:34, 20:50]), name)

    def test_cameras_are_words_or_dicts(self) -> None:
        low, high = creek().bounds
        middle = (low + high) / 2
        eye = middle + [0, -200, 150]
        words = "eye={},{},{};target={},{},{};fovy=40".format(
            *map(repr, [*eye.tolist(), *middle.tolist()])
        )
        a = esker.render(creek(), size=(64, 40), camera=words, backend="cpu")
        b = esker.render(
            creek(), size=(64, 40), camera={"eye": eye, "target": middle, "fovy": 40}, backend="cpu"
        )
        self.assertTrue(np.array_equal(a, b))
        self.assertEqual(a.report.camera["fovy"], 40)

    def test_scene_documents_are_drawn(self) -> None:
        program = esker_program()
        if program is None:
            self.skipTest("ESKER_PROGRAM does not name the program esker")
        scene = self.folder / "scene.json"
        line = [program, "render", creek().path, "--size", "64x40", "--colour", "elevation"]
        subprocess.run([*line, "--save-scene", scene], check=True, capture_output=True)
        own = esker.render(scene, backend="cpu")
        other = esker.render(creek(), size=(64, 40), colour="elevation", backend="cpu")
        self.assertTrue(np.array_equal(own, other))

    def test_wrong_arguments_are_named(self) -> None:
        for options, error, message in (
            ({"size": (0, 10)}, ValueError, "0x10"),
            ({"size": (10**6, 10**6)}, ValueError, "1000000"),
            ({"method": "best"}, ValueError, "no method best; there are auto"),
            ({"camera": "eye=1,2"}, ValueError, "camera"),
            ({"colour": "mood"}, esker.EskerError, "mood"),
            ({"backend": "tpu"}, ValueError, "not tpu"),
            ({"outputs": ["index"], "method": "lit"}, esker.EskerError, "neither lit"),
            ({"outputs": ["heat"]}, ValueError, "no output 'heat'"),
            ({"shadows": 3}, ValueError, "no option shadows"),
            ({"method": "lit", "samples": 0}, ValueError, "samples: 0"),
        ):
            with self.subTest(options=options), self.assertRaisesRegex(error, message):
                creek().render(**{"size": (32, 32), **options})


if __name__ == "__main__":
    unittest.main()
