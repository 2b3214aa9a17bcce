"""Put workflow/, config/ and docs/ into the wheel; an editable installation finds them in the clone."""

import shutil
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py


class BuildWithWorkflow(build_py):
    """Copies what `strandcast.workflow.project.shipped` returns into the package."""

    def run(self) -> None:
        """Build the package from nothing, then copy."""
        if not self.editable_mode:
            shutil.rmtree(self.build_lib, ignore_errors=True)
        super().run()
        if not self.editable_mode:
            shipped = Path(self.build_lib, "strandcast", "shipped")
            for name in ("workflow", "config", "docs"):
                shutil.copytree(name, shipped / name)
            if Path("build", "kernels").is_dir():  # made by `make wheel`
                shutil.copytree(Path("build", "kernels"), shipped / "kernels")


setup(cmdclass={"build_py": BuildWithWorkflow})
