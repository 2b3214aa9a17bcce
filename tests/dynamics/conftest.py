"""Make the proofs importable: modules beside the tests that the tests and the planted faults share."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
