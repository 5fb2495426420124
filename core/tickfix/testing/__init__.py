"""The conformance kit: five lines of yours, dozens of named checks.

::

    from tickfix.testing import FilterContract
    from my_package import MyFilter


    class TestMyFilter(FilterContract):
        algorithm = MyFilter

Every check is a test method whose message says what was found and what to mend. The world that they use
(:mod:`tickfix.testing.world`) is there for your own tests too.
"""

from tickfix.testing.calls import ContractError
from tickfix.testing.contract import AlgorithmContract
from tickfix.testing.filters import FilterContract
from tickfix.testing.fingerprints import FingerprintContract
from tickfix.testing.maps import MapContract
from tickfix.testing.pdrs import PdrContract

__all__ = [
    "AlgorithmContract",
    "ContractError",
    "FilterContract",
    "FingerprintContract",
    "MapContract",
    "PdrContract",
]
