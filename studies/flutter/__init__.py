"""Flutter: complex eigenvalues of loops over T/N, N/l and asymmetry."""
