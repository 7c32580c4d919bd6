"""Shortest paths on a raster."""

import heapq
import math

import numpy as np
from numba import njit

__all__ = ["shortest_way"]


@njit(cache=True, nogil=True)
def shortest_way(cost, start, goal):
    """Return the cells (K, 2) of the cheapest path between two cells; empty if there is none.

    By A* (Hart, Nilsson and Raphael, IEEE Transactions on Systems Science and Cybernetics 4, 1968)
    to the eight neighbours, without cutting corners.

    Args:
        cost: (Y, X) cost per cell length, 1 or more; infinite if impassable.
        start: row and column of the first cell.
        goal: row and column of the last cell.
    """
    high, wide = cost.shape
    spent = np.full((high, wide), np.inf)
    previous = np.full((high, wide), -1, np.int64)
    done = np.zeros((high, wide), np.bool_)
    spent[start[0], start[1]] = 0.0
    queue = [(0.0, start[0] * wide + start[1])]
    while queue:
        _, cell = heapq.heappop(queue)
        y, x = cell // wide, cell % wide
        if done[y, x]:
            continue
        done[y, x] = True
        if y == goal[0] and x == goal[1]:
            break
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                v, u = y + dy, x + dx
                if not (0 <= v < high and 0 <= u < wide) or done[v, u]:
                    continue
                if cost[v, u] == np.inf or cost[y, u] == np.inf or cost[v, x] == np.inf:
                    continue
                now = spent[y, x] + math.hypot(dx, dy) * (cost[y, x] + cost[v, u]) / 2
                if now < spent[v, u]:
                    spent[v, u], previous[v, u] = now, cell
                    rest = math.hypot(v - goal[0], u - goal[1])
                    heapq.heappush(queue, (now + rest, v * wide + u))
    if not done[goal[0], goal[1]]:
        return np.zeros((0, 2), np.int64)
    cells = [goal[0] * wide + goal[1]]
    while cells[-1] != start[0] * wide + start[1]:
        cells.append(previous[cells[-1] // wide, cells[-1] % wide])
    path = np.empty((len(cells), 2), np.int64)
    for k in range(len(cells)):
        path[k, 0], path[k, 1] = cells[len(cells) - 1 - k] // wide, cells[len(cells) - 1 - k] % wide
    return path
