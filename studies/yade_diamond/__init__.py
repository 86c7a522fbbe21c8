"""The diamond by another code: Yade's forces along straight strain paths, ours, and Yade's step.

Run as `python -m studies.yade_diamond --out DIR [--data DIR]`. Four discs of Yade 2023.02a are
confined by an isotropic strain `E0` and then driven along a straight line in (E1, E2), with Yade's
shear increment by radii (its default) or by branch (the paper's), sticking or sliding. The closed
forms of `patterns.diamond.strain_lines` follow the same strains. What is left between the two is
Yade's step: replaying its rule at its own step gives its forces to rounding.
"""
