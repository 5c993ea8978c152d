"""The examples of the docstrings give what they show, and everything public has a docstring."""

import doctest
import importlib
import pkgutil
import unittest

import loadtwin


def load_tests(loader, tests, pattern):
    for module in pkgutil.walk_packages(loadtwin.__path__, "loadtwin."):
        if not module.name.endswith(("__main__", "_loadtwin")):
            tests.addTests(doctest.DocTestSuite(importlib.import_module(module.name)))
    tests.addTests(doctest.DocTestSuite(loadtwin))
    return tests


class TestPackage(unittest.TestCase):
    def test_everything_public_is_documented(self):
        for name in loadtwin.__all__:
            self.assertTrue(name == "__version__" or getattr(loadtwin, name).__doc__, name)


if __name__ == "__main__":
    unittest.main()
