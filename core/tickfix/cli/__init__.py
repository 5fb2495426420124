"""The ``tickfix`` command: it parses, asks the rest of tickfix, and prints."""

import os

# Bits are promised for one BLAS thread, and walks already share the cores; libraries read this once, when imported.
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
