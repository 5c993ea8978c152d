"""Wheel and source distribution: what is in them, their size, and that they install.

`LOADTWIN_INSTALLS` compiles and installs them, and a clone; without it their contents are tested. Compiling the wheel
alone takes more than the 4 minutes that a run of all tests has for it.
"""

import os
import re
import subprocess
import sys
import tarfile
import tempfile
import time
import unittest
import zlib
from pathlib import Path

from loadtwin import _loadtwin

#: Where all of them compile, so that they compile the dependencies once, and not again in the next run.
TARGET = Path("target/installs").absolute()

#: Size of a wheel [bytes].
LARGEST = 30e6

PACKAGE = Path("host/python")

REPLAY = """
import loadtwin, pathlib
root = pathlib.Path(%r)
machine = loadtwin.Machine(root / "examples/gearbox/calibrated.toml")
estimates, state = machine.replay(root / "examples/gearbox/start-stop.parquet")
print(len(estimates), loadtwin.__file__)
"""


def run(*call, **options):
    done = subprocess.run([str(part) for part in call], capture_output=True, text=True, **options)
    assert done.returncode == 0, f"{call}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_modules(folder):
    """Files of Rust that only tests compile."""
    declared = re.compile(r"#\[cfg\(test\)\](?:\s+#\[[^]]*\])*\s+mod (\w+);")
    for file in folder.glob("**/src/**/*.rs"):
        inner = file.parent if file.stem in ("mod", "lib") else file.with_suffix("")
        for name in declared.findall(file.read_text()):
            yield inner / f"{name}.rs"


def absent(folder):
    """Files that are compiled into the library, but are not there."""
    tests = set(test_modules(folder))
    for file in set(folder.glob("**/src/**/*.rs")) - tests:
        compiled = file.read_text().split("#[cfg(test)]\nmod tests {")[0]
        for name in re.findall(r'include_(?:str|bytes)!\(\s*"([^"]+)"', compiled):
            if not (file.parent / name).is_file():
                yield f"{file.relative_to(folder)}: {name}"


class TestInstall(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def unpacked(self):
        run(sys.executable, "-m", "maturin", "sdist", "-m", PACKAGE / "Cargo.toml", "-o", self.folder)
        (archive,) = self.folder.glob("loadtwin-*.tar.gz")
        with tarfile.open(archive) as tar:
            tar.extractall(self.folder, filter="data")
        return self.folder / archive.name.removesuffix(".tar.gz")

    def test_a_source_distribution_is_complete(self):
        folder = self.unpacked()
        run("cargo", "metadata", "--offline", "--format-version", "1", cwd=folder)
        self.assertEqual(list(absent(folder)), [])
        for name in ("LICENSE-APACHE", "LICENSE-MIT", "PKG-INFO", "Cargo.lock"):
            self.assertTrue((folder / name).is_file(), name)
        ours = {path.relative_to(PACKAGE / "python") for path in (PACKAGE / "python").glob("**/*") if path.is_file()}
        ours = {path for path in ours if path.suffix not in (".pyc", ".so")}
        (package,) = (path.parent for path in folder.glob("**/loadtwin/py.typed"))
        there = {path.relative_to(package.parent) for path in package.glob("**/*") if path.is_file()}
        self.assertEqual(ours - there, set())
        # What is compiled in is looked for: without the file it is found to be absent.
        (folder / "host/can/loadtwin.dbc").unlink()
        self.assertEqual(list(absent(folder)), ["host/can/src/dbc.rs: ../loadtwin.dbc"])

    def test_the_library_fits_into_a_small_wheel(self):
        # With the symbols that a wheel leaves out.
        size = len(zlib.compress(Path(_loadtwin.__file__).read_bytes()))
        print(f"library: {size / 1e6:.1f} MB")
        self.assertLess(size, LARGEST)

    @unittest.skipUnless("LOADTWIN_INSTALLS" in os.environ, "compiles for minutes: tests/run long")
    def test_wheel_source_distribution_and_clone_install(self):
        began = time.monotonic()
        run(
            *(sys.executable, "-m", "maturin", "build", "--release", "--sdist"),
            *("-m", PACKAGE / "Cargo.toml", "-o", self.folder, "-i", sys.executable),
            env={**os.environ, "CARGO_TARGET_DIR": str(TARGET)},
        )
        (wheel,), (source,) = self.folder.glob("*.whl"), self.folder.glob("*.tar.gz")
        print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, compiled in {time.monotonic() - began:.0f} s")
        self.assertLess(wheel.stat().st_size, LARGEST)
        self.assertIn("-abi3-", wheel.name)
        clone = self.folder / "clone"
        run("git", "clone", "-q", "--depth", "1", Path.cwd().as_uri(), clone)
        for installed in (wheel, source, clone / PACKAGE):
            with self.subTest(installed.name):
                began = time.monotonic()
                self.install(installed)
                print(f"{installed.name}: installed in {time.monotonic() - began:.0f} s")

    def install(self, installed):
        environment = self.folder / f"venv-{installed.name}"
        run(sys.executable, "-m", "venv", environment)
        python = environment / "bin/python"
        target = {**os.environ, "CARGO_TARGET_DIR": str(TARGET)}
        del target["PYTHONPATH"]
        run(python, "-m", "pip", "install", "-q", installed, env=target, cwd=self.folder)
        rows, file = run(python, "-c", REPLAY % str(Path.cwd()), env=target, cwd=self.folder).split()
        self.assertEqual(rows, "45000")
        self.assertTrue(Path(file).is_relative_to(environment), file)
        self.assertIn("loadtwin", run(environment / "bin/loadtwin", "--version", env=target))


if __name__ == "__main__":
    unittest.main()
