"""The examples in the docstrings of all public names run as they stand."""

import contextlib
import doctest
import inspect
from importlib import import_module

import numpy as np
import pytest
from helpers import documents

import relight
import shading
import shadow

NAMES = [(package, name) for package in (relight, shadow, shading) for name in package.__all__]
FINDER = doctest.DocTestFinder(recurse=False)
# Further modules whose docstrings have examples; those of methods are run too.
MODULES = (
    "relight.analysis.camera",
    "relight.analysis.components",
    "relight.errors",
    "relight.lights.light",
    "relight.media.regular_file",
    "relight.subject",
)
RUNNER_OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that the examples name, small."""
    folder = tmp_path_factory.mktemp("examples")
    documents.lay_out(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "name"), NAMES, ids=[f"{package.__name__}.{name}" for package, name in NAMES]
)
def test_the_example_runs(package, name, folder):
    found = getattr(package, name)
    names = {"relight": relight, "shadow": shadow, "shading": shading, "np": np}
    (test,) = FINDER.find(found, name, globs=names, module=inspect.getmodule(found))
    assert test.examples, f"{package.__name__}.{name} has no example"
    with contextlib.chdir(folder):
        results = doctest.DocTestRunner(optionflags=RUNNER_OPTIONS).run(test)
    assert not results.failed


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name):
    with contextlib.chdir(documents.ROOT):
        results = doctest.testmod(import_module(name), optionflags=RUNNER_OPTIONS)
    assert results.attempted
    assert not results.failed
