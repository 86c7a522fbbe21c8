"""Stability of a tangent: spectra, second-order work, cones, the unstable fraction, verdicts.

Every function takes plain arrays with leading batch axes: a macroscopic tangent `A (..., 4, 4)` in
the component order (11, 12, 21, 22), or an operator `K (..., m, m)` already restricted.
"""

from typing import TYPE_CHECKING

from loops.lazy import lazy_face

if TYPE_CHECKING:
    from stability import programmes as programmes
    from stability.complementarity import Family as Family
    from stability.destabilising import LinearControl as LinearControl
    from stability.destabilising import destabilising_control as destabilising_control
    from stability.destabilising import softening_control as softening_control
    from stability.destabilising import strain_driven as strain_driven
    from stability.directional import BranchFraction as BranchFraction
    from stability.directional import DirectionalWork as DirectionalWork
    from stability.directional import branch_fraction as branch_fraction
    from stability.directional import directional_work as directional_work
    from stability.follow import follow as follow
    from stability.path import Event as Event
    from stability.path import Path as Path
    from stability.paths.supported import SupportedRates as SupportedRates
    from stability.paths.supported import slip_problem as slip_problem
    from stability.programmes import Programme as Programme
    from stability.programmes import Stage as Stage
    from stability.rates_at import rates_at as rates_at
    from stability.regimes import RateSolution as RateSolution
    from stability.regimes import Regimes as Regimes
    from stability.second_order_work import PlaneCone as PlaneCone
    from stability.second_order_work import PolarDiagram as PolarDiagram
    from stability.second_order_work import alpha_e as alpha_e
    from stability.second_order_work import (
        normalised_second_order_work as normalised_second_order_work,
    )
    from stability.second_order_work import plane_cone as plane_cone
    from stability.second_order_work import polar_diagram as polar_diagram
    from stability.second_order_work import second_order_work as second_order_work
    from stability.second_order_work import unstable_fraction as unstable_fraction
    from stability.spectra import COMPONENTS as COMPONENTS
    from stability.spectra import RTOL as RTOL
    from stability.spectra import bromwich_margin as bromwich_margin
    from stability.spectra import flutter_pairs as flutter_pairs
    from stability.spectra import operator_norm as operator_norm
    from stability.spectra import restrict as restrict
    from stability.spectra import rotate_tangent as rotate_tangent
    from stability.spectra import spectrum as spectrum
    from stability.spectra import subspace_basis as subspace_basis
    from stability.spectra import symmetric_modes as symmetric_modes
    from stability.spectra import symmetric_part as symmetric_part
    from stability.spectra import symmetric_spectrum as symmetric_spectrum
    from stability.verdict import Verdict as Verdict
    from stability.verdict import judge as judge
    from stability.verdict import statuses as statuses

lazy_face(__name__)
