"""Where C declares the variables of a function: in the innermost block that has all their uses."""

from typing import NamedTuple

# A block of C: the ifs and loops around it, each with the number of its branch.
Block = tuple[tuple[int, int], ...]


class Use(NamedTuple):
    """A use of a variable: the block, whether it is assigned there, and the scenes."""

    block: Block
    is_stored: bool
    mask: int


def homes(uses: list[Use]) -> dict[Block, bool]:
    """Return the blocks that declare a variable, each with whether its first assignment there does so.

    Later blocks that begin with an assignment declare it again if nothing behind them uses what they assign.
    """
    shared = shared_block([use.block for use in uses])
    runs: list[tuple[Block, list[Use]]] = []  # neighbouring uses in the same block below
    for use in uses:
        child = use.block[: len(shared) + 1]
        if runs and runs[-1][0] == child:
            runs[-1][1].append(use)
        else:
            runs.append((child, [use]))
    found: dict[Block, bool] = {}
    while runs and len(runs[-1][0]) > len(shared):
        last = runs[-1][1]
        inner, own = homes(last), shared_block([use.block for use in last])
        if not (last[0].is_stored and last[0].block == own and inner.get(own)):
            break
        found |= inner
        runs.pop()
    rest = [use for _, run in runs for use in run]
    if not rest:
        return found
    if found and shared_block([use.block for use in rest]) != shared:
        return {**found, **homes(rest)}
    declared, at_once = 0, True
    for block, is_stored, mask in rest:
        if mask & ~declared:
            at_once = at_once and is_stored and block == shared and not mask & declared
            declared |= mask
    return {**found, shared: at_once}


def shared_block(blocks: list[Block]) -> Block:
    """Return the innermost block that has all of them."""
    least = min(blocks, key=len)
    for k, part in enumerate(least):
        if any(block[k] != part for block in blocks):
            return least[:k]
    return least
