"""Where the parameters stand in the flat vectors, by their names.

Every parameter acts on one output i through one input: a bias through 1, a matrix element [i,j] through component j of
what the triad measures, a g-sensitivity [i,j] through component j of the specific force in g. A Jacobian is therefore
known from the parameters' outputs and inputs alone.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from ...physics.parameter_names import parse


class TriadErrors(NamedTuple):
    """Error parameters of a triad, a set for each dwell; zero where the estimator has none."""

    bias: Float[np.ndarray, "dwell 3"]
    matrix: Float[np.ndarray, "dwell 3 3"]
    g_sensitivity: Float[np.ndarray, "dwell 3 3"]


class Layout:
    """Kind, output and input of each parameter."""

    def __init__(self, names: tuple[str, ...]):
        found = [parts for parts in map(parse, names) if parts is not None]
        assert len(found) == len(names)  # the names of the estimators themselves
        self.names = names
        self.output = np.array([parts.row for parts in found])
        self._column = np.array([parts.column for parts in found])
        self._of = {
            kind: np.array([parts.kind == kind for parts in found], bool)
            for kind in ("bias", "matrix", "g_sensitivity")
        }

    @property
    def size(self) -> int:
        """Number of parameters."""
        return len(self.output)

    def unpack(self, vectors: Float[np.ndarray, "dwell parameter"]) -> TriadErrors:
        """The vectors as biases and matrices."""
        count = len(vectors)
        bias, matrix, by_force = (np.zeros((count, 3, *more)) for more in ((), (3,), (3,)))
        bias[:, self._rows("bias")] = vectors[:, self._of["bias"]]
        for kind, into in (("matrix", matrix), ("g_sensitivity", by_force)):
            into[:, self._rows(kind), self._column[self._of[kind]]] = vectors[:, self._of[kind]]
        return TriadErrors(bias, matrix, by_force)

    def pack(
        self,
        bias: Float[np.ndarray, "dwell 3"],
        matrix: Float[np.ndarray, "dwell 3 3"],
        g_sensitivity: Float[np.ndarray, "dwell 3 3"],
    ) -> Float[np.ndarray, "dwell parameter"]:
        """Inverse of `unpack` for errors of the estimator's own form."""
        vectors = np.empty((len(bias), self.size))
        vectors[:, self._of["bias"]] = bias[:, self._rows("bias")]
        for kind, source in (("matrix", matrix), ("g_sensitivity", g_sensitivity)):
            vectors[:, self._of[kind]] = source[:, self._rows(kind), self._column[self._of[kind]]]
        return vectors

    def inputs(
        self,
        measured: Float[np.ndarray, "*batch 3"],
        force: Float[np.ndarray, "*batch 3"],
    ) -> Float[np.ndarray, "*batch parameter"]:
        """What each parameter is multiplied by: 1, a component of `measured`, or of the force in g."""
        result = np.ones((*measured.shape[:-1], self.size))
        for kind, source in (("matrix", measured), ("g_sensitivity", force)):
            result[..., self._of[kind]] = source[..., self._column[self._of[kind]]]
        return result

    def _rows(self, kind: str) -> np.ndarray:
        return self.output[self._of[kind]]
