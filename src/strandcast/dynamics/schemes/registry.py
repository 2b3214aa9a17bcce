"""Integration schemes by name: ``estimate.integrator``."""

from strandcast.core.registry import Registry
from strandcast.dynamics.schemes.explicit import EULER, SEMI_IMPLICIT
from strandcast.dynamics.schemes.lfcn import LFCN
from strandcast.dynamics.schemes.scheme import Scheme

SCHEMES: Registry[Scheme] = Registry(
    "integration scheme",
    "strandcast.schemes",
    "SC-E006",
    "estimate.integrator",
    {scheme.name: scheme for scheme in (LFCN, SEMI_IMPLICIT, EULER)},
)
