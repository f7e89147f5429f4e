"""Makes the truths and the bank of test/ importable, for the scripts that import it first."""

from pathlib import Path
import sys

sys.path.insert(1, str(Path(__file__).resolve().parents[1] / 'test'))
