"""The conformance kit: five lines of yours, dozens of named checks.

::

    from tickfix.testing import FilterContract from my_package import MyFilter


    class TestMyFilter(FilterContract):
        algorithm = MyFilter

Every check is a test method whose message names what was found and what to change. The world that they use
(:mod:`tickfix.testing.world`) is available to your own tests too.
"""

from tickfix.testing.contract import AlgorithmContract, ContractError
from tickfix.testing.filter_contract import FilterContract
from tickfix.testing.fingerprint_contract import FingerprintContract
from tickfix.testing.map_contract import MapContract
from tickfix.testing.pdr_contract import PdrContract

__all__ = [
    "AlgorithmContract",
    "ContractError",
    "FilterContract",
    "FingerprintContract",
    "MapContract",
    "PdrContract",
]
