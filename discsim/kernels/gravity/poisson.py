"""Copies of the Poisson solver between rows, tiles and columns of the half-transformed field, and products with the
kernel.

A tile (nx, TILE) holds TILE columns and is contiguous: copies from rows to tiles and from tiles to columns have no
long strides. Buffers are wider than their content, so that their rows do not map to the same cache lines.
"""

from discsim.jit.decorators import inline_jit, jit

TILE = 8  # columns: two cache lines of complex numbers


@jit
def load_rows(field, first, rows):
    """Copy rows first, first + 1, ... of a field (nx, ny) to `rows` (batch, >= ny)."""
    for i in range(min(rows.shape[0], field.shape[0] - first)):
        row = rows[i]
        for j in range(field.shape[1]):
            row[j] = field[first + i, j]


@jit
def store_rows(rows, first, shift, border, field):
    """Copy `rows` back to a field, `shift` rows further on, from the last to the first.

    The last `border` nodes of a row go before its first node.
    """
    count, held = field.shape[0], field.shape[1] - border
    for i in range(min(rows.shape[0], count - first)):
        out, row = field[(first + i + shift) % count], rows[i]
        for j in range(held):
            out[border + j] = row[j]
        for j in range(border):
            out[j] = row[len(row) - border + j]


@jit
def rows_to_tiles(rows, first, tiles):
    """Copy rows (batch, tiles TILE) to rows first, first + 1, ... of `tiles` (tiles, nx, TILE)."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                tiles[t, first + i, c] = rows[i, t * TILE + c]


@jit
def tiles_to_rows(tiles, first, rows):
    """Copy rows of `tiles` to `rows`, the reverse of `rows_to_tiles`."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                rows[i, t * TILE + c] = tiles[t, first + i, c]


@jit
def load_columns(tile, columns):
    """Copy the columns of a tile (nx, TILE) to `columns` (TILE, >= nx)."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            columns[c, i] = tile[i, c]


@jit
def store_columns(columns, tile):
    """Copy `columns` to a tile, the reverse of `load_columns`."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            tile[i, c] = columns[c, i]


@jit
def multiply_columns(columns, quadrant, first, length):
    """Multiply columns by the kernel's transform. The kernel is even, so `quadrant` (ky, kx) has half of the kx.

    `columns` (TILE, >= 2 length) are real and imaginary parts in turn.
    """
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply(columns[c], quadrant[first + c], length, 1)


@inline_jit
def _multiply(column, factor, length, unpaired):
    # factor[k] belongs to mode k. The kernel is even: modes from the last one back have the same factors, from index
    # `unpaired` on, which is 1 where mode 0 has no mirror image, and 0 where each mode has one.
    half = len(factor)
    for k in range(half):
        column[2 * k] *= factor[k]
        column[2 * k + 1] *= factor[k]
    for k in range(length - half):
        column[2 * (length - 1 - k)] *= factor[k + unpaired]
        column[2 * (length - 1 - k) + 1] *= factor[k + unpaired]


@jit
def load_halves(tile, nx, wave, columns):
    """Copy the first nx rows of a tile to `columns` (2, TILE, >= n): as they are, and times `wave` (n,).

    Rows from nx up to n are 0. With wave[i] = exp(-j pi i / n) the transforms of the two, of length n, are the even
    and the odd modes of a transform of length 2n. Its second half is padding (decimation in frequency; Cooley & Tukey
    1965).
    """
    for i in range(nx):
        for c in range(TILE):
            columns[0, c, i], columns[1, c, i] = tile[i, c], tile[i, c] * wave[i]
    columns[:, :, nx : len(wave)] = 0.0


@jit
def store_halves(columns, nx, border, wave, tile):
    """Write rows of the inverse transform of length 2n to a tile.

    `columns` (2, TILE, >= n) has the inverse transforms of even and of odd modes. Row i < n is even + conj(wave[i])
    odd, and row n + i is even - conj(wave[i]) odd. The tile gets the first nx rows, the `border` rows after them and
    then the last `border` of all, which lie before the first.
    """
    count = len(wave)
    for i in range(min(nx + border, count)):
        back = wave[i].conjugate()
        for c in range(TILE):
            tile[i, c] = columns[0, c, i] + back * columns[1, c, i]
    for i in range(count, nx + border):
        _store_beyond(columns, i - count, wave, tile[i])
    for i in range(border):
        _store_beyond(columns, count - border + i, wave, tile[nx + border + i])


@inline_jit
def _store_beyond(columns, i, wave, row):
    # Row i of the second half: its wave has the opposite sign.
    back = wave[i].conjugate()
    for c in range(TILE):
        row[c] = columns[0, c, i] - back * columns[1, c, i]


@jit
def multiply_halves(columns, quadrant, first, length):
    """Apply `multiply_columns` to even and then odd modes, `columns` (2, TILE, >= 2 length).

    `quadrant` has the even kx before the odd ones.
    """
    even = length // 2 + 1
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply(columns[0, c], quadrant[first + c, :even], length, 1)
        _multiply(columns[1, c], quadrant[first + c, even:], length, 0)
