"""multiply: products of stacked float32 matrices in compiled code, with 512-bit registers.

A product is made tile by tile. The sums of a tile stay in registers while a loop runs over the
terms (Goto & van de Geijn 2008, "Anatomy of high-performance matrix multiplication", section 4).
Compilers do not find that by themselves, so tiles are written in LLVM's own language. Every number
of a product is summed in the same order, in tiles of all sizes.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from swarmdata.runtime.kernels import kernel

LANES = 16
"""Numbers in a register, and the least number of columns of a product."""

TALL, WIDE = 6, 4 * LANES
"""Rows and columns of a large tile, whose sums are in 24 of the 32 registers."""

DEPTH = 128
"""Terms that tiles sum at a time: so many rows of b stay in the nearest caches meanwhile."""

SIZE = 4
"""Bytes of a number."""

INDEX, NUMBER = ir.IntType(64), ir.FloatType()
VECTOR = ir.VectorType(NUMBER, LANES)
FIRST_LANES = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)


class _Memory:
    """Loads and stores of a builder, with addresses and strides in numbers."""

    def __init__(self, builder: Any, n_columns: int) -> None:
        self.builder, self.columns = builder, range(0, n_columns, LANES)

    def begin(self, address: Any, row: Any, stride: Any) -> Any:
        """The place of a row. It is an offset of a pointer: LLVM follows sums of numbers badly."""
        return self.builder.gep(address, [self.builder.mul(row, stride)])

    def vectors(self, begin: Any) -> list[Any]:
        """The places of a row's vectors."""
        places = (self.builder.gep(begin, [INDEX(column)]) for column in self.columns)
        return [self.builder.bitcast(place, VECTOR.as_pointer()) for place in places]

    def read(self, begin: Any) -> list[Any]:
        """The vectors of a row."""
        return [self.builder.load(place, align=SIZE) for place in self.vectors(begin)]

    def spread(self, place: Any) -> Any:
        """A vector of one number."""
        number = self.builder.load(place, align=SIZE)
        alone = self.builder.insert_element(VECTOR(ir.Undefined), number, ir.IntType(32)(0))
        return self.builder.shuffle_vector(alone, alone, FIRST_LANES)


def _tile(n_rows: int, n_columns: int) -> tuple[Any, Any]:
    """Returns signature and code of c[m, n] = start[m, n] + sum_k a[m, k] b[k, n] for one tile.

    Its arguments are addresses, strides in numbers, and the number of terms.
    """

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        *addresses, strides, depth = arguments
        a, b, start, c = (builder.inttoptr(base, NUMBER.as_pointer()) for base in addresses)
        a_row, a_column, b_row, start_row, c_row = cgutils.unpack_tuple(builder, strides)
        memory, rows = _Memory(builder, n_columns), [INDEX(m) for m in range(n_rows)]
        kind = ir.FunctionType(VECTOR, [VECTOR] * 3)
        fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{LANES}f32")
        begun = (memory.read(memory.begin(start, m, start_row)) for m in rows)
        sums = [[cgutils.alloca_once_value(builder, part) for part in row] for row in begun]
        firsts = [memory.begin(a, m, a_row) for m in rows]
        with cgutils.for_range(builder, depth) as loop:
            terms = memory.read(memory.begin(b, loop.index, b_row))
            for first, row in zip(firsts, sums, strict=True):
                factor = memory.spread(memory.begin(first, loop.index, a_column))
                for part, term in zip(row, terms, strict=True):
                    builder.store(builder.call(fused, [factor, term, builder.load(part)]), part)
        for m, row in zip(rows, sums, strict=True):
            for part, place in zip(row, memory.vectors(memory.begin(c, m, c_row)), strict=True):
                builder.store(builder.load(part), place, align=SIZE)
        return context.get_dummy_value()

    strides = types.UniTuple(types.int64, 5)
    return types.void(*[types.int64] * 4, strides, types.int64), generate


@intrinsic
def _tall_wide(_context: Any, a: Any, b: Any, start: Any, c: Any, strides: Any, depth: Any) -> Any:
    return _tile(TALL, WIDE)


@intrinsic
def _flat_wide(_context: Any, a: Any, b: Any, start: Any, c: Any, strides: Any, depth: Any) -> Any:
    return _tile(1, WIDE)


@intrinsic
def _tall_thin(_context: Any, a: Any, b: Any, start: Any, c: Any, strides: Any, depth: Any) -> Any:
    return _tile(TALL, LANES)


@intrinsic
def _flat_thin(_context: Any, a: Any, b: Any, start: Any, c: Any, strides: Any, depth: Any) -> Any:
    return _tile(1, LANES)


@kernel
def _strip(
    n_rows: int, is_wide: bool, a: int, b: int, start: int, c: int,
    strides: tuple[int, int, int, int, int], depth: int,
) -> None:  # fmt: skip
    """Adds terms to the sums of all rows in the columns of one tile; arguments as of a tile."""
    a_row, start_row, c_row = SIZE * strides[0], SIZE * strides[3], SIZE * strides[4]
    row = 0
    while row < n_rows:
        place_a, place_start, place_c = a + row * a_row, start + row * start_row, c + row * c_row
        if row + TALL <= n_rows:
            if is_wide:
                _tall_wide(place_a, b, place_start, place_c, strides, depth)
            else:
                _tall_thin(place_a, b, place_start, place_c, strides, depth)
            row += TALL
        else:
            if is_wide:
                _flat_wide(place_a, b, place_start, place_c, strides, depth)
            else:
                _flat_thin(place_a, b, place_start, place_c, strides, depth)
            row += 1


@kernel
def multiply(
    sizes: tuple[int, int, int, int],
    a: int, a_strides: tuple[int, int, int],
    b: int, b_strides: tuple[int, int],
    start: int, start_stride: int,
    c: int,
) -> None:  # fmt: skip
    """c[r] = start[r] + a[r] b[r] of R matrices; arguments are addresses and strides in numbers.

    Args:
        sizes: R, rows, columns, terms; there are 16 columns at least, and one term.
        a: [R, rows, terms].
        a_strides: of its axes.
        b: [R, terms, columns]; columns lie side by side.
        b_strides: of its first two axes.
        start: one row for each matrix, [R, columns]; columns lie side by side.
        start_stride: of its first axis.
        c: [R, rows, columns], contiguous.
    """
    n_matrices, n_rows, n_columns, n_terms = sizes
    is_wide = n_columns >= WIDE
    width = WIDE if is_wide else LANES
    for r in range(n_matrices):
        for column in range(0, n_columns, width):
            # the last tile begins so early that it fits, and makes some columns twice
            shift = min(column, n_columns - width)
            place_c = c + SIZE * (r * n_rows * n_columns + shift)
            for k in range(0, n_terms, DEPTH):
                # the first terms are added to the start, later ones to what is there
                begin = place_c if k else start + SIZE * (r * start_stride + shift)
                strides = (
                    a_strides[1],
                    a_strides[2],
                    b_strides[1],
                    n_columns if k else 0,
                    n_columns,
                )
                place_a = a + SIZE * (r * a_strides[0] + k * a_strides[2])
                place_b = b + SIZE * (r * b_strides[0] + k * b_strides[1] + shift)
                depth = min(DEPTH, n_terms - k)
                _strip(n_rows, is_wide, place_a, place_b, begin, place_c, strides, depth)
