"""Speed against error of the methods that a user chooses between, and the hard cases."""

from studies.bench.run import run_bench as run_bench
