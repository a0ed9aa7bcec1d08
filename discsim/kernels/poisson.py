"""The half-transformed field in tiles of TILE columns, columns in small buffers, and the product with the kernel.

A tile (nx, TILE) is contiguous: rows are put into tiles, and tiles turned into columns, without long strides.
Buffers are wider than what they hold, so that their rows do not share their place in the cache.
"""

from discsim.jit.decorators import compiled, inner

TILE = 8  # columns: two lines of the cache


@compiled
def load_rows(field, first, rows):
    """Rows first, first + 1, ... of a field (nx, ny) into `rows` (batch, >= ny)."""
    for i in range(min(rows.shape[0], field.shape[0] - first)):
        row = rows[i]
        for j in range(field.shape[1]):
            row[j] = field[first + i, j]


@compiled
def store_rows(rows, first, shift, border, field):
    """The reverse of `load_rows`, `shift` rows further on, from the last to the first; the last `border` nodes of a row
    are put before its first.
    """
    count, held = field.shape[0], field.shape[1] - border
    for i in range(min(rows.shape[0], count - first)):
        out, row = field[(first + i + shift) % count], rows[i]
        for j in range(held):
            out[border + j] = row[j]
        for j in range(border):
            out[j] = row[len(row) - border + j]


@compiled
def rows_to_tiles(rows, first, tiles):
    """Rows (batch, tiles TILE) into rows first, first + 1, ... of `tiles` (tiles, nx, TILE)."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                tiles[t, first + i, c] = rows[i, t * TILE + c]


@compiled
def tiles_to_rows(tiles, first, rows):
    """The reverse of `rows_to_tiles`."""
    for t in range(tiles.shape[0]):
        for i in range(min(rows.shape[0], tiles.shape[1] - first)):
            for c in range(TILE):
                rows[i, t * TILE + c] = tiles[t, first + i, c]


@compiled
def load_columns(tile, columns):
    """Columns of a tile (nx, TILE) into `columns` (TILE, >= nx)."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            columns[c, i] = tile[i, c]


@compiled
def store_columns(columns, tile):
    """The reverse of `load_columns`."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            tile[i, c] = columns[c, i]


@compiled
def multiply_columns(columns, quadrant, first, length):
    """Multiply by the kernel's transform: `quadrant` (ky, kx) has half of the kx, for it is even.

    `columns` (TILE, >= 2 length) are real and imaginary parts in turn.
    """
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply(columns[c], quadrant[first + c], length, 1)


@inner
def _multiply(column, factor, length, unpaired):
    # factor[k] is that of mode k. The kernel is even: modes from the last one back have the same factors, from number
    # `unpaired` on, which is 1 where mode 0 has no mirror image, and 0 where each mode has one.
    half = len(factor)
    for k in range(half):
        column[2 * k] *= factor[k]
        column[2 * k + 1] *= factor[k]
    for k in range(length - half):
        column[2 * (length - 1 - k)] *= factor[k + unpaired]
        column[2 * (length - 1 - k) + 1] *= factor[k + unpaired]


@compiled
def load_halves(tile, nx, wave, columns):
    """Columns of the first nx rows of a tile into columns[0] of `columns` (2, TILE, >= n), and times `wave` (n,) into
    columns[1]; zeros in rows from nx up to n.

    With wave[i] = exp(-j pi i / n) their transforms, of length n, are the even and the odd modes of the transform of
    length 2n, of which the second half is padding (decimation in frequency; Cooley & Tukey 1965).
    """
    for i in range(nx):
        for c in range(TILE):
            columns[0, c, i], columns[1, c, i] = tile[i, c], tile[i, c] * wave[i]
    columns[:, :, nx : len(wave)] = 0.0


@compiled
def store_halves(columns, nx, border, wave, tile):
    """Rows of the inverse transform of length 2n from those of even and of odd modes, `columns` (2, TILE, >= n), into a
    tile: row i < n is even + conj(wave[i]) odd, and row n + i is even - conj(wave[i]) odd. There are nx rows, the
    `border` after them and, behind these, the last `border` of all, which are those before the first.
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


@inner
def _store_beyond(columns, i, wave, row):
    # Row i of the second half: its wave has the other sign.
    back = wave[i].conjugate()
    for c in range(TILE):
        row[c] = columns[0, c, i] - back * columns[1, c, i]


@compiled
def multiply_halves(columns, quadrant, first, length):
    """`multiply_columns` for even and then odd modes, `columns` (2, TILE, >= 2 length); `quadrant` has the even kx
    before the odd ones.
    """
    even = length // 2 + 1
    for c in range(min(TILE, quadrant.shape[0] - first)):
        _multiply(columns[0, c], quadrant[first + c, :even], length, 1)
        _multiply(columns[1, c], quadrant[first + c, even:], length, 0)
