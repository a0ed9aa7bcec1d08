"""Loops of the Poisson solver: copies between buffers for transforms along y and along x, and the kernel's product.

The solver transforms the rows of a field along y, and then the columns of the result along x. Between the two
transforms it stores the field in tiles. A tile (nx, TILE) is contiguous and has TILE columns, so that no copy from
rows to tiles, or from tiles to columns, has long strides. Buffers are wider than their content, so that their rows
do not map to the same cache lines; a shape with ">= n" is that of a wider buffer.
"""

from discsim.jit.decorators import inline_jit, jit

TILE = 8  # columns: two cache lines of complex numbers


@jit
def load_rows(field, first, rows):
    """Copy the rows of `field` (nx, ny) from row `first` on to the buffer `rows` (batch, >= ny)."""
    for i in range(min(rows.shape[0], field.shape[0] - first)):
        row = rows[i]
        for j in range(field.shape[1]):
            row[j] = field[first + i, j]


@jit
def store_rows(rows, first, shift, border, field):
    """Copy `rows` (batch, >= ny) to `field`, from row first + shift on; after the last row comes row 0.

    border: number of nodes that are taken from the end of a row and written before its first node.
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
    """Copy `rows` (batch, >= m * TILE) into `tiles` (m, nx, TILE): row i of `rows` goes to tiles[:, first + i]."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                tiles[t, first + i, c] = rows[i, t * TILE + c]


@jit
def tiles_to_rows(tiles, first, rows):
    """Copy tiles[:, first + i] to row i of `rows`, for all rows: the reverse of `rows_to_tiles`."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                rows[i, t * TILE + c] = tiles[t, first + i, c]


@jit
def load_columns(tile, columns):
    """Copy the columns of `tile` (nx, TILE) to the rows of `columns` (TILE, >= nx)."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            columns[c, i] = tile[i, c]


@jit
def store_columns(columns, tile):
    """Copy `columns` to `tile`: the reverse of `load_columns`."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            tile[i, c] = columns[c, i]


@jit
def multiply_columns(columns, quadrant, first, length):
    """Multiply `columns` (TILE, >= 2 * length), in place, by the kernel's transform.

    A row of `columns` has `length` complex modes kx of one ky, with real and imaginary parts alternating. quadrant
    (ky, kx): the transform, which is real and even; `quadrant` has only the first half of the kx. first: ky of the
    first row.
    """
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply_column(columns[c], quadrant[first + c], length, 1)


@inline_jit
def _multiply_column(column, factor, length, unpaired):
    """Multiply the `length` complex modes in `column`, in place, by real factors that are even in the mode number.

    factor[k] is for mode k of the first half. Mode length - 1 - k of the second half has factor[k + unpaired], where
    `unpaired` is 1 if mode 0 has no mirror image, and 0 if each mode has one.
    """
    half = len(factor)
    for k in range(half):
        column[2 * k] *= factor[k]
        column[2 * k + 1] *= factor[k]
    for k in range(length - half):
        column[2 * (length - 1 - k)] *= factor[k + unpaired]
        column[2 * (length - 1 - k) + 1] *= factor[k + unpaired]


@jit
def load_halves(tile, nx, wave, columns):
    """Copy the columns of `tile` to columns[0], and the columns times `wave` (n,) to columns[1].

    columns: (2, TILE, >= n); entries from nx to n, which pad the nx rows of the tile, are set to 0. With wave[i] =
    exp(-j pi i / n), the two transforms of length n are the even and the odd modes of a transform of length 2n whose
    second half is padding (decimation in frequency; Cooley & Tukey 1965).
    """
    for i in range(nx):
        for c in range(TILE):
            columns[0, c, i], columns[1, c, i] = tile[i, c], tile[i, c] * wave[i]
    columns[:, :, nx : len(wave)] = 0.0


@jit
def store_halves(columns, nx, border, wave, tile):
    """Write to `tile` those rows of an inverse transform of length 2n that the solver needs.

    columns (2, TILE, >= n): the inverse transforms `even` and `odd` of the even and odd modes. Row i < n of the whole
    transform is even[i] + conj(wave[i]) odd[i], and row n + i is even[i] - conj(wave[i]) odd[i]. The tile gets the
    first nx rows, the `border` rows after them, and the last `border` rows, which lie before the first row in periodic
    order.
    """
    count = len(wave)
    for i in range(min(nx + border, count)):
        phase = wave[i].conjugate()
        for c in range(TILE):
            tile[i, c] = columns[0, c, i] + phase * columns[1, c, i]
    for i in range(count, nx + border):
        _store_beyond(columns, i - count, wave, tile[i])
    for i in range(border):
        _store_beyond(columns, count - border + i, wave, tile[nx + border + i])


@inline_jit
def _store_beyond(columns, i, wave, row):
    """Write row n + i of `store_halves` to `row` (TILE,)."""
    phase = wave[i].conjugate()
    for c in range(TILE):
        row[c] = columns[0, c, i] - phase * columns[1, c, i]


@jit
def multiply_halves(columns, quadrant, first, length):
    """Multiply the even modes columns[0] and the odd modes columns[1], in place, by the kernel's transform.

    columns: (2, TILE, >= 2 * length), with `length` even and `length` odd modes. quadrant (ky, kx): as in
    `multiply_columns`, but with all even kx before the odd ones. first: ky of the first row.
    """
    even = length // 2 + 1
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply_column(columns[0, c], quadrant[first + c, :even], length, 1)
        _multiply_column(columns[1, c], quadrant[first + c, even:], length, 0)
