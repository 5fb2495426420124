"""The ``tickfix`` command: a thin layer that parses arguments, calls the packages below and prints."""

import os

# Bits are promised for one BLAS thread, and walks already share the cores; libraries read this once, when imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
