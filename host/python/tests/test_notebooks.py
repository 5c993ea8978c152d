"""The notebooks run, and so do the examples of the guide; both compare what they find."""

import os
import re
import tempfile
import time
import unittest
from pathlib import Path

import matplotlib.pyplot as plt

NOTEBOOKS = Path("examples/notebooks")
GUIDES = {Path("docs/how-to/python.md"): 5, Path("docs/how-to/archive.md"): 2}


class TestNotebooks(unittest.TestCase):
    def setUp(self):
        self.addCleanup(plt.close, "all")

    def test_notebooks(self):
        notebooks = sorted(NOTEBOOKS.glob("*.py"))
        self.assertEqual(len(notebooks), 4)
        began = time.monotonic()
        for notebook in notebooks:
            with self.subTest(notebook.name):
                text = notebook.read_text()
                self.assertTrue(text.startswith("# %% [markdown]"))
                exec(compile(text, notebook, "exec"), {"__name__": "__main__"})
                plt.close("all")
        taken_s = time.monotonic() - began
        print(f"{len(notebooks)} notebooks: {taken_s:.0f} s")
        self.assertLess(taken_s, 300)

    def test_guides(self):
        for guide, least in GUIDES.items():
            with self.subTest(guide.name):
                self.run_blocks(guide, least)

    def run_blocks(self, guide, least):
        blocks = re.findall(r"^```python\n(.*?)^```", guide.read_text(), re.M | re.S)
        self.assertGreaterEqual(len(blocks), least)
        namespace = {}
        with tempfile.TemporaryDirectory() as folder:
            # Files that the guide writes go to a folder beside the clone's own.
            for name in ("examples", "docs"):
                os.symlink(Path(name).resolve(), Path(folder) / name)
            here = Path.cwd()
            os.chdir(folder)
            try:
                for block in blocks:
                    exec(compile(block, guide, "exec"), namespace)
            finally:
                os.chdir(here)


if __name__ == "__main__":
    unittest.main()
