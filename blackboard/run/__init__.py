"""Running processes: what all doors share, the launcher and its supervisor, health checks."""

import os

# One thread for NumPy, before it is loaded: with several, products round in another way, and boards on two hosts would differ in the
# last bit; and the matrices here are so small that threads cost more than they give.
for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(name, "1")
