"""The small project of the exports, for the pages that need results."""

from tests.exports.conftest import project

__all__ = ["project"]
