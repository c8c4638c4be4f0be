"""Simulated worlds: the physics, the tasks and their rendering.

Arguments of compiled functions, here and in `behavior_policies`, where nothing else is said:

    states, state    [E, S] of all copies, [S] of one; columns are those of `specs.state_layout`
    before, after    states before and after a step; targets and extras of `after` are to be updated
    layouts, layout  obstacles, [E, M, 8] and [M, 8]; columns are those of `geometry.OBSTACLE`
    active, times    [E] copies that take the step; control steps since the reset, this one included
    seeds, copies    of episodes, and the rows to write them to, [C]; in a step, seeds of all copies
    terms, solved    [E, N, R] and [E], written: the task's own terms, unweighted; whether solved
    robots, body     [N, 6 or more], first x, y, vx, vy; [7] columns `state_layout.BODY`
    limits, radii    [N, 9] of `dynamics.limits_of` (`limit`: a row); [N] m
    half             [2] half width and half height of the arena, m
    i, j; n; b       robots; how many there are; a copy
    state: Seeds     [1] of a random generator
    out              written
"""

if not __name__.startswith("swarmdata."):
    raise ImportError(f"import swarmdata.{__name__}, not {__name__}")
