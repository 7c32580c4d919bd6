"""The lengths of lists in the rows of a PLY, compiled by numba only for files with lists."""

import numba

__all__ = ["ascii_lengths", "binary_lengths"]


@numba.njit(cache=True)
def binary_lengths(data, at, lengths, sizes, counts, big):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Fill the lengths of lists; return the number of complete rows and their end."""
    last = len(data)
    for row in range(lengths.shape[0]):
        for column in range(len(sizes)):
            length = 1
            if counts[column]:
                if at + counts[column] > last:
                    return row, at
                length = 0
                for byte in range(counts[column]):
                    shift = counts[column] - 1 - byte if big else byte
                    length += int(data[at + byte]) << (8 * shift)
                at += counts[column]
                lengths[row, column] = length
            if length < 0 or length > (last - at) // sizes[column]:
                return row, at
            at += length * sizes[column]
    return lengths.shape[0], at


@numba.njit(cache=True)
def ascii_lengths(values, at, lengths, is_list):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Fill the lengths of lists; return the number of complete rows and their end."""
    for row in range(lengths.shape[0]):
        for column in range(len(is_list)):
            length = 1
            if is_list[column]:
                if at >= len(values):
                    return row, at
                length = int(values[at])
                at += 1
                lengths[row, column] = length
            if length < 0 or length > len(values) - at:
                return row, at
            at += length
    return lengths.shape[0], at
