"""The page's fixed text."""

from __future__ import annotations

HEAD = "# Accuracy\n"
MEASURED = (
    "Every number comes from that run. Times are processor time per item, the fastest of several "
    "runs on one thread; memory (MB) is the peak that Python and numpy asked for in one call "
    "(tracemalloc). The oracle is of higher precision: mpmath with 50 digits, exact quadrature, or "
    "rational arithmetic; doubles that go in are taken as exact."
)

KNEES = """## Speed against error

A ring marks what the code does when nothing is asked; dots on the line 1e-17 stand for an error of
zero; an error of 1 means that some item got no answer; the dotted line is the unit of rounding,
2.2e-16. The knee is the cheapest setting whose error is rounding (1e-14) or, where none reaches it,
within ten times the least error.
"""

SOLVERS = """## What every solver says of its own error

| solver | what it reports | what happens where no digit is left |
|---|---|---|
| `affine_tangent`, spins blocked or affine | `condition` 1: a sum, nothing is solved | - |
| `affine_tangent`, spins free | `condition`, `residual`, ambiguity of null vectors, `error` | the operator is NaN, `trusted` false |
| `traction_tangent`, force method | `condition`: sum of the compliances' sizes times the squares of their levers, times the operator | the saddle system is tried, then NaN |
| `traction_tangent`, saddle system | `condition` of the bordered system and softness of the loop, `residual`, ambiguity | NaN, `trusted` false |
| `macroscopic_tangent` | as the closure it calls | as that closure |
| `solve_through_null_space` | `condition`, `nullity`, `residual`, `ambiguity` | NaN and an infinite residual for a system that is not finite |
| `rates_at`, `solve_rate_problem` | `rates.condition`, `trusted` of every combination, count of `singular` ones | the combination counts for no solution |
| `follow` | `condition`, `imbalance` and `energy_error` of every row | the path ends as `lost` or `control_limit` with a message |
| `directional_work`, `branch_fraction` | `singular` combinations, standard `error` of sampled fractions (zero where exact) | NaN |
| `judge`, `statuses` | `tolerance`: rtol plus the error bound of the tangent | `undetermined` |
| `plane_cone` | `status` 'ray' or 'undetermined' within the tolerance; determinant free of rounding | 'undetermined' |
| `unstable_fraction`, `imhof_fraction` | error stated in the docstring: some units in the last place; 1e-15 | NaN |
| `spectrum`, `symmetric_spectrum` | backward stable: error below 1e-15 of the norm | NaN for an operator that is not finite |
| `destabilising_control`, `softening_control` | `status`, and `work` as the residual: zero along an isotropic direction | 'singular' or 'undetermined' |
| `drained_path`, `drained_end` | `status`; quadrature to rounding | NaN |

`MacroTangent.error = 8 eps condition |A|` bounds the error of the operator. `judge(tangent,
subspace)` and `statuses(..., error=tangent.error)` widen their undetermined band by it, so an
eigenvalue whose sign rounding could have turned gets no sign. A tangent whose bound exceeds its own
size is not a number.
"""  # noqa: E501

HARD = """## The hard cases

The registry `patterns.hard_cases.HARD_CASES` names them; tests and this page run the same ones. One
letter a value, from mild to extreme: `s` stable, `u` unstable, `?` undetermined, `e` refused with a
message. The largest error is that of the operator over its norm, and the bound what the solver
states. `ends at`: the first value whose verdict is undetermined though 50 digits tell it.
"""

STIFF = """## Stiff grains

Overlaps from 1e-1 to 1e-12: an irregular hexagon, its contacts at half their friction (elastic) or
all sliding, and a diamond, all sliding. Blocks are inverted in the contacts' own frames, where no
digits are lost; in the global frame the determinant of a stiff sliding contact cancels to `kn N/l`.
Under the affine closure, and with elastic contacts, the overlap costs nothing. The relaxed hexagon
whose contacts all slide is as soft as `N/l` in all directions but one: there the error of the
operator, relative to its stiff part, grows as one over the overlap, and the stated bound with it.
The error is in the size of the stiff part: the directions of the form, hence the edges of the cone
in (11, 22) and the unstable fraction, keep all their digits. Edges are shown where there is a cone.
The verdict holds down to 1e-12, where the bound reaches a hundredth of the operator.
"""

SMALLEST = """## Smallest model

`follow` finds the symmetry that a scene and its programme share and solves for the freedoms that it
leaves; elastic states skip the branch search. Drained paths of regular loops, smallest model / full
model: processor time of a path (one run each), unknowns of the system of its rates, solves in the
branch search, and how far states, tangents and rates lie apart at events and ends.
"""

LIMITS = """## Limits

- Verdicts are undetermined within 1e-12 of the operator's norm (`RTOL`), plus the solver's bound. A
  loop flatter than about 1e-6, or softer in one direction by 1e-12, is beyond that.
- Errors count from doubles taken as exact. Positions written with six digits carry an error of 1e-6
  of the position: overlaps of stiff grains are then unknown, whatever the solver does.
- The bound is first order in the unit of rounding. Norms make it wide, near a singular contact or
  in soft loops by several powers of ten; in what was tried here it is never too narrow.
- Reading one contact's regime from a state needs `|T|` within four roundings of `mu N`; directions
  and paths treat contacts within 1e-10 of yield as at the edge and let the motion decide.
- Where kappa is far below 1e-3 the eigenvalues of Ks and of K of a symmetric diamond cross zero
  within one rounding; a path under the affine closure may then record `det_Ks_zero` alone.
- Free spins in long rings: the oracle here ends at 12 grains; beyond, the bound alone speaks.
- tracemalloc does not see the memory of compiled kernels' stacks or of LAPACK's own workspaces.
"""
