"""`python -m strandcast`."""

from strandcast.cli.main import main

main()
