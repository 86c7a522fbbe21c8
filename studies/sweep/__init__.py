"""A sweep of random diamonds to the end of the elastic drained path, against scipy's `solve_ivp`.

Run as `python -m studies.sweep --out DIR [--diamonds 100000]`. Reference angle, stiffness ratio,
friction and confinement are drawn at random; point B, where all four contacts yield under constant
`s2`, comes from the exact solution for all diamonds at once (`patterns.diamond.drained_end`). Per
path, `solve_ivp` integrates `dE2/dE1 = -K21/K22`, `ds1/dE1 = det K/K22` (33) up to the event
`|T| = mu N`. Errors are against the quadrature in 25 digits; mpmath comes with the extra `test`.
"""
