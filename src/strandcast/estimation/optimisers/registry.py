"""Optimisers by name: ``estimate.search``."""

from strandcast.core.registry import Registry
from strandcast.estimation.optimisers.descent import search_by_descent
from strandcast.estimation.optimisers.optimiser import Optimiser
from strandcast.estimation.optimisers.paper import search_like_the_paper
from strandcast.estimation.optimisers.screened import search_screened
from strandcast.estimation.optimisers.thorough import search_thoroughly

OPTIMISERS: Registry[Optimiser] = Registry(
    "optimiser",
    "strandcast.optimisers",
    "estimate.search",
    {
        "descent": search_by_descent,
        "screened": search_screened,
        "thorough": search_thoroughly,
        "paper": search_like_the_paper,
    },
)
