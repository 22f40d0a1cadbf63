"""Long calls: other threads run beside them, and Ctrl-C ends them."""

from __future__ import annotations

import signal
import subprocess
import sys
import textwrap
import threading
import unittest

import esker
import numpy as np
from support import Case, creek

#: A program that builds until it is interrupted.
BUILDS = """
    import signal, sys, esker
    # A shell ignores it for programs that it starts in the background.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    def told(progress):
        if progress.done:
            print("working", flush=True)
    try:
        esker.build("synthetic:terrain:20M:1", sys.argv[1], progress=told, memory="512MiB")
    except KeyboardInterrupt:
        print("interrupted", flush=True)
"""


class LongCalls(Case):
    @unittest.skipIf(sys.platform == "win32", "Windows has no SIGINT for one process")
    def test_ctrl_c_ends_a_build_and_leaves_no_file(self) -> None:
        line = [sys.executable, "-c", textwrap.dedent(BUILDS), str(self.folder / "a.esker")]
        with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as process:
            self.assertEqual(process.stdout.readline(), "working\n")
            process.send_signal(signal.SIGINT)
            rest = process.stdout.read()
        self.assertEqual(rest.splitlines()[-1], "interrupted")
        self.assertEqual([p.name for p in self.folder.iterdir()], [])

    def test_other_threads_run_while_the_engine_works(self) -> None:
        done = threading.Event()
        calls = {
            "build": lambda: esker.build("synthetic:terrain:300k:1", self.folder / "a.esker"),
            "query": lambda: [creek().query() for _ in range(3)],
            "render": lambda: creek().render(size=(640, 480), backend="cpu"),
            "verify": lambda: creek().verify(),
        }
        for name, call in calls.items():
            with self.subTest(call=name):
                done.clear()

                def work() -> None:
                    try:
                        call()
                    finally:
                        done.set()

                started = threading.Thread(target=work)
                started.start()
                turns = 0
                # Without the interpreter lock this loop would turn a few times at most.
                while not done.is_set():
                    turns += 1
                started.join()
                self.assertGreater(turns, 1000)

    def test_chunks_that_were_stopped_give_no_rest(self) -> None:
        class Enough(Exception):
            pass

        def stop(progress: esker.Progress) -> None:
            raise Enough

        chunks = creek().chunks(10, columns=[], progress=stop)
        with self.assertRaises(Enough):
            for _ in chunks:
                pass
        with self.assertRaisesRegex(esker.EskerError, "begin again"):
            next(chunks)

    def test_queries_of_several_threads_are_right(self) -> None:
        file = creek()
        wanted = len(file.query(classes=2, columns=[]))
        counts: list[int] = []
        threads = [
            threading.Thread(target=lambda: counts.append(len(file.query(classes=2, columns=[]))))
            for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(counts, [wanted] * 4)

    def test_chunks_need_little_memory(self) -> None:
        if not sys.platform.startswith("linux"):
            self.skipTest("memory is measured by the kernel of Linux")
        program = """
            import resource, sys, esker
            file = esker.open(sys.argv[1])
            before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            count = sum(len(points) for points in file.chunks(100_000))
            after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            print(count, (after - before) * 1024)
        """
        path = self.folder / "a.esker"
        esker.build("synthetic:terrain:8M:1", path, normals="none")
        file = esker.open(path)
        line = [sys.executable, "-c", textwrap.dedent(program), str(path)]
        out = subprocess.run(line, check=True, capture_output=True, text=True).stdout.split()
        self.assertEqual(int(out[0]), 8_000_000)
        whole = file.count * file.dtype.itemsize
        self.assertLess(int(out[1]), 0.6 * whole)

    def test_arrays_may_change_while_they_are_built_from(self) -> None:
        xyz = np.random.default_rng(1).random((200_000, 3))
        stop = threading.Event()

        def change() -> None:
            while not stop.is_set():
                xyz[:, 2] += 1e-9

        changer = threading.Thread(target=change)
        changer.start()
        try:
            report = esker.build({"xyz": xyz}, self.folder / "a.esker", scale=0.001)
        finally:
            stop.set()
            changer.join()
        self.assertEqual(report.points_out, 200_000)


if __name__ == "__main__":
    unittest.main()
