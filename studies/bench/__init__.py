"""Speed against error of every method with a choice, and the hard cases."""

from studies.bench.run import run_bench as run_bench
