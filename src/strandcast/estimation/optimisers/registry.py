"""Optimisers by name: ``estimate.search``."""

from strandcast.core.registry import Registry
from strandcast.estimation.optimisers.cma_es import search_by_cma_es
from strandcast.estimation.optimisers.descent import search_by_descent
from strandcast.estimation.optimisers.evolution import search_by_evolution
from strandcast.estimation.optimisers.optimiser import Optimiser
from strandcast.estimation.optimisers.paper import search_like_the_paper
from strandcast.estimation.optimisers.thorough import search_thoroughly

OPTIMISERS: Registry[Optimiser] = Registry(
    "optimiser",
    "strandcast.optimisers",
    "SC-E007",
    "estimate.search",
    {
        "descent": search_by_descent,
        "thorough": search_thoroughly,
        "cma": search_by_cma_es,
        "evolution": search_by_evolution,
        "paper": search_like_the_paper,
    },
)
