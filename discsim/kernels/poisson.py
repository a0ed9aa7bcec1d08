"""The half-transformed field in tiles of TILE columns, columns in small buffers, and the product with the kernel.

A tile (nx, TILE) is contiguous: rows are put into tiles, and tiles turned into columns, without long strides.
Buffers are wider than what they hold, so that their rows do not share their place in the cache.
"""

from discsim.kernels.inner import compiled

TILE = 8  # columns: two lines of the cache


@compiled
def load_rows(field, first, rows):
    """Rows first, first + 1, ... of a field (nx, ny) into `rows` (batch, >= ny)."""
    for i in range(min(rows.shape[0], field.shape[0] - first)):
        rows[i, : field.shape[1]] = field[first + i]


@compiled
def store_rows(rows, first, shift, border, field):
    """The reverse of `load_rows`, `shift` rows further on, from the last to the first; the last `border` nodes of a row
    are put before its first.
    """
    count, held = field.shape[0], field.shape[1] - border
    for i in range(min(rows.shape[0], count - first)):
        out, row = field[(first + i + shift) % count], rows[i]
        out[border:] = row[:held]
        out[:border] = row[rows.shape[1] - border :]


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
def load_columns(tile, length, columns):
    """Columns of a tile (nx, TILE) into `columns` (TILE, >= length), padded with zeros to `length`."""
    for i in range(tile.shape[0]):
        for c in range(TILE):
            columns[c, i] = tile[i, c]
    columns[:, tile.shape[0] : length] = 0.0


@compiled
def store_columns(columns, length, border, tile):
    """The reverse of `load_columns`; the last `border` of a `length` are put after those before them."""
    held = tile.shape[0] - border
    for i in range(held):
        for c in range(TILE):
            tile[i, c] = columns[c, i]
    for i in range(border):
        for c in range(TILE):
            tile[held + i, c] = columns[c, length - border + i]


@compiled
def multiply_columns(columns, quadrant, first, length):
    """Multiply by the kernel's transform: `quadrant` (ky, kx) has half of the kx, for it is even.

    `columns` (TILE, >= 2 length) are real and imaginary parts in turn.
    """
    half = quadrant.shape[1]
    for c in range(min(TILE, quadrant.shape[0] - first)):
        column, factor = columns[c], quadrant[first + c]
        for k in range(half):
            column[2 * k] *= factor[k]
            column[2 * k + 1] *= factor[k]
        for k in range(1, length - half + 1):
            column[2 * (length - k)] *= factor[k]
            column[2 * (length - k) + 1] *= factor[k]
