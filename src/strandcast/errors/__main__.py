"""`python -m strandcast.errors` prints docs/errors.md."""

from strandcast.errors.registry import errors_page

print(errors_page(), end="")
