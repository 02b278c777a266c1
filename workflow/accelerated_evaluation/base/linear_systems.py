"""Solve small systems of linear equations in compiled code."""

from accelerated_evaluation.base.arrays import Array
from accelerated_evaluation.base.compiling import cached_njit


@cached_njit()
def solve(matrix: Array, right: Array) -> None:
    """Overwrite the right-hand side with the solution, and the diagonal of the matrix with the pivots.

    The matrix is positive definite and small. Such a matrix needs no pivoting, and for a small one a call of
    LAPACK would take longer than the solution. The determinant is the product of the pivots.
    """
    size = len(right)
    for one in range(size):
        for two in range(one + 1, size):
            factor = matrix[two, one] / matrix[one, one]
            right[two] -= factor * right[one]
            for column in range(one, size):
                matrix[two, column] -= factor * matrix[one, column]
    for one in range(size - 1, -1, -1):
        for two in range(one + 1, size):
            right[one] -= matrix[one, two] * right[two]
        right[one] /= matrix[one, one]
