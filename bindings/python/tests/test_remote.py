"""Files at addresses, from a server on this machine."""

from __future__ import annotations

import functools
import http.server
import threading
import unittest
from pathlib import Path

import esker
import numpy as np
from support import Case, creek, scan_path


class Ranges(http.server.SimpleHTTPRequestHandler):
    """Answers requests for ranges of the files of a folder."""

    protocol_version = "HTTP/1.1"
    has_ranges = True

    def do_HEAD(self) -> None:
        self.answer(False)

    def do_GET(self) -> None:
        self.answer(True)

    def answer(self, has_body: bool) -> None:
        path = Path(self.directory, self.path.lstrip("/"))
        if not path.is_file():
            self.send_error(404)
            return
        data = path.read_bytes()
        size, asked = len(data), self.headers.get("Range")
        if asked and self.has_ranges:
            first, last = asked.removeprefix("bytes=").split("-")
            begin = int(first) if first else size - int(last)
            end = min(int(last), size - 1) if first and last else size - 1
            data = data[begin : end + 1]
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {begin}-{end}/{size}")
        else:
            self.send_response(200)
        self.send_header("ETag", f'"{size}"')
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        if has_body:
            self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass


class Whole(Ranges):
    """Ignores ranges."""

    has_ranges = False


class Addresses(Case):
    def serve(self, handler: type[Ranges]) -> str:
        """Starts a server of the shared folder; its address."""
        folder = str(Path(creek().path).parent)
        server = http.server.ThreadingHTTPServer(
            ("127.0.0.1", 0), functools.partial(handler, directory=folder)
        )
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        self.addCleanup(thread.join)
        self.addCleanup(server.server_close)
        self.addCleanup(server.shutdown)
        return f"http://127.0.0.1:{server.server_port}"

    def test_queries_of_addresses_are_those_of_files(self) -> None:
        file = esker.open(self.serve(Ranges) + "/creek.esker")
        self.assertEqual(file.count, creek().count)
        low, high = file.bounds
        box = (low[:2], (low + (high - low) * 0.3)[:2])
        for conditions in ({"bounds": box}, {"resolution": 8.0, "columns": ["intensity"]}):
            own, other = creek().query(**conditions), file.query(**conditions)
            self.assertTrue(np.array_equal(own.array(), other.array()))
        chunks = list(file.chunks(400_000, columns=["gps_time"]))
        joined = np.concatenate([chunk["gps_time"] for chunk in chunks])
        self.assertTrue(np.array_equal(joined, creek().query(columns=["gps_time"])["gps_time"]))

    def test_pictures_and_builds_take_addresses(self) -> None:
        address = self.serve(Ranges)
        own = creek().render(size=(64, 48), backend="cpu")
        other = esker.render(address + "/creek.esker", size=(64, 48), backend="cpu")
        self.assertTrue(np.array_equal(own, other))
        report = esker.build(f"{address}/{scan_path().name}", self.folder / "a.esker")
        self.assertEqual(report.points_out, creek().count)

    def test_servers_that_cannot_serve_are_named(self) -> None:
        with self.assertRaisesRegex(
            (OSError, esker.EskerError), "creek.esker.*does not send parts"
        ):
            esker.open(self.serve(Whole) + "/creek.esker")
        with self.assertRaisesRegex(FileNotFoundError, "no.esker"):
            esker.open(self.serve(Ranges) + "/no.esker")


if __name__ == "__main__":
    unittest.main()
