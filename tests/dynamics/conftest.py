"""The proofs of this room are modules beside its tests: they serve the tests and the planted faults alike."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
