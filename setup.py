"""Builds the page of the service into the wheel; the rest of the packaging is pyproject.toml."""

import runpy
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

HERE = Path(__file__).resolve().parent


class BuildWithPage(build_py):
    """An installation from a checkout (editable) has the page from scripts/page."""

    def run(self) -> None:
        """Build the page, then collect the packages with it."""
        if not self.editable_mode:
            runpy.run_path(str(HERE / "scripts" / "lib" / "build_page.py"))["build_page"]()
        super().run()


setup(cmdclass={"build_py": BuildWithPage})
