"""Do the tests notice a flipped sign or a dropped term? Mutants of `loops` and `stability`."""
