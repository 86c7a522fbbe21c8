"""The mutants of a source file: one sign, term, factor or comparison changed in each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.operators.operator import Operator
from cosmic_ray.plugins import get_operator

BUILT_IN = {
    "sign": (
        "ReplaceBinaryOperator_Add_Sub",
        "ReplaceBinaryOperator_Sub_Add",
        "ReplaceUnaryOperator_Delete_USub",
    ),
    "factor": ("ReplaceBinaryOperator_Mul_Div", "ReplaceBinaryOperator_Div_Mul"),
    "comparison": (
        "ReplaceComparisonOperator_Lt_GtE",
        "ReplaceComparisonOperator_LtE_Gt",
        "ReplaceComparisonOperator_Gt_LtE",
        "ReplaceComparisonOperator_GtE_Lt",
        "ReplaceComparisonOperator_Eq_NotEq",
        "ReplaceComparisonOperator_NotEq_Eq",
    ),
}


class DropTerm(Operator):
    """Leave a term out of a sum: `a + b - c` becomes `a - c`, `a + b`, and `b - c`."""

    def mutation_positions(self, node: Any) -> Iterator[tuple[Any, Any]]:
        """One for each term that can go."""
        if node.type == "arith_expr":
            first_goes = node.children[1].value == "+"
            terms = node.children[2::2]
            for term in [node.children[0], *terms] if first_goes else terms:
                yield term.start_pos, term.end_pos

    def mutate(self, node: Any, index: int) -> Any:
        """Drop a term and the sign before it; of the first one, the sign behind it."""
        if node.children[1].value != "+":
            index += 1
        start = 2 * index - 1 if index else 0
        rest = node.children[:start] + node.children[start + 2 :]
        if not index:
            rest[0].get_first_leaf().prefix = node.get_first_leaf().prefix
        node.children = rest
        return node

    @classmethod
    def examples(cls) -> tuple[Any, ...]:
        """None: the tests have them."""
        return ()


class Mutant(NamedTuple):
    """One change: the operator's `occurrence`-th place in the file, at `line` (from 1)."""

    file: str
    kind: str
    operator: str
    occurrence: int
    line: int
    before: str

    @property
    def name(self) -> str:
        """How the list of equivalent mutants calls it: stable while the line stays."""
        return f"{self.file}: {self.kind}: {self.before}"


def mutants_of(root: Path, file: str) -> list[Mutant]:
    """Every mutant of a file."""
    source = (root / file).read_text()
    lines, nodes = source.splitlines(), list(ast_nodes(get_ast(source)))
    found = []
    for kind, name, operator in _operators():
        places = [
            (start[0], node) for node in nodes for start, _ in operator.mutation_positions(node)
        ]
        found += [
            Mutant(file, kind, name, occurrence, line, lines[line - 1].strip())
            for occurrence, (line, node) in enumerate(places)
            # The star of keyword-only arguments is no product.
            if node.parent is None or node.parent.type != "parameters"
        ]
    return found


def mutated(source: str, mutant: Mutant) -> str:
    """The source with the change."""
    operator = next(one for _, name, one in _operators() if name == mutant.operator)
    changed = mutate_code(source, operator, mutant.occurrence)
    if changed is None or changed == source:
        raise ValueError(f"no such place: {mutant}")
    return str(changed)


def _operators() -> Iterator[tuple[str, str, Operator]]:
    yield "term", "DropTerm", DropTerm()
    for kind, names in BUILT_IN.items():
        for name in names:
            yield kind, name, get_operator(f"core/{name}")()
