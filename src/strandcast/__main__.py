"""`python -m strandcast`."""

from strandcast.cli import main

main()
