"""Columns of the half-transformed field in small buffers, and the product with the kernel's transform."""

from numba import njit


@njit(nogil=True, cache=True, error_model="numpy")
def load_columns(field, first, columns):
    """Columns first, first + 1, ... of `field` (nx, k) into the rows of `columns` (batch, >= nx)."""
    for i in range(field.shape[0]):
        for c in range(min(columns.shape[0], field.shape[1] - first)):
            columns[c, i] = field[i, first + c]


@njit(nogil=True, cache=True, error_model="numpy")
def store_columns(columns, first, field):
    """The reverse of `load_columns`."""
    for i in range(field.shape[0]):
        for c in range(min(columns.shape[0], field.shape[1] - first)):
            field[i, first + c] = columns[c, i]


@njit(nogil=True, cache=True, error_model="numpy")
def multiply_columns(columns, quadrant, first):
    """Multiply by the kernel's transform: `quadrant` (ky, kx) has half of the kx, for it is even."""
    length = columns.shape[1]
    half = quadrant.shape[1]
    for c in range(min(columns.shape[0], quadrant.shape[0] - first)):
        factor = quadrant[first + c]
        for k in range(half):
            columns[c, k] *= factor[k]
        for k in range(half, length):
            columns[c, k] *= factor[length - k]
